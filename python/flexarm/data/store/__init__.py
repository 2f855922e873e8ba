"""Files: written whole or not at all, checked, and taken up again where the same was asked."""
