"""Checked input, files written whole, optional imports, colours."""
