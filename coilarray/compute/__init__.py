"""Threads, workers, memory and files: no physics."""
