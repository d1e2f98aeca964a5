"""Tracks, motion models and how well a model describes a group of tracks."""
