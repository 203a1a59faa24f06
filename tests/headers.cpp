// Of this target only the precompiled headers are used.
