"""Many runs at once: batches on the fast kernels, threads, executors, files that resume."""
