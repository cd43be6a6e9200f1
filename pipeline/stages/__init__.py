"""Stages: each reads files, calls pure functions, writes files. They meet in files only."""
