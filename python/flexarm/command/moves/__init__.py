"""Planned moves: fast, within limits, without vibration at their end."""
