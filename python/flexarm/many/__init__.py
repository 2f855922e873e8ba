"""Many runs: batches and rollouts, and runs over parameters."""
