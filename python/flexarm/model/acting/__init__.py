"""Actions on an arm: laws of time, drives, loads, motors, voltages of patches, controllers, input shapers."""
