"""Pictures and films of arms: see view.py."""
