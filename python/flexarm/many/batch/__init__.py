"""Many runs at once.

From low to high: arguments (checks), job (a batch), problems (in the core), rollout (from arrays to arrays), gradient
and differentiable (derivatives of rollouts), by_steps and by_simulate (the two engines), storage (memory or a file),
result, executor (workers elsewhere), runner (chunk by chunk), simulate.
"""
