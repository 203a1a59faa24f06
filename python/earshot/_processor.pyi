"""Importing this module raises ImportError where the processor lacks instructions that the engine is compiled for."""
