"""The shipped scene of a measured arm against its recordings: `fa.validate` and `flexarm validate`."""
