"""Many runs at once.

From low to high: arguments (checks), job (a batch), problems (in the core), rollout (from arrays to arrays), gradient
and differentiable (derivatives of rollouts), by_steps (a chunk of a batch in the core), storage (memory or a file),
result, executor (workers elsewhere), runner (chunk by chunk), simulate.
"""
