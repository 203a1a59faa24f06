# SPDX-License-Identifier: Apache-2.0
"""Importing this module raises ImportError where the processor lacks instructions that the engine is compiled for."""
