"""A fuzzer: scene files, pictures and grids of strangers, mutated from the shipped ones.

Each case is told by its seed and number alone. It ends in a refusal of one line or in sane results; anything else,
an exception, a warning of NumPy, a hang, much memory, a file outside the build folder, is a failure and written down.
"""
