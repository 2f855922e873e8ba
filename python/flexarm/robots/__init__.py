"""Robot files: URDF and MJCF to links, and arms to URDF and MJCF."""
