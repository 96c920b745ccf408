"""The tables, one small module each."""
