"""Scenes with exact truth: point sets and rendered image sequences."""
