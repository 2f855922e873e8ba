"""Many runs at once.

From low to high: arguments (checks), job (a batch), problems (run and judged), rollout (arrays to arrays), gradient
(derivatives of rollouts), storage (memory or a file), result, executor (workers elsewhere), runner (chunk by chunk),
simulate.
"""
