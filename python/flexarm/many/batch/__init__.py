"""Many runs at once: batches in the lanes of vectors, threads, executors, files that resume."""
