"""Kernels: functions that run as compiled code or as plain Python, whichever answers sooner.

`jit` makes a function a kernel. `mode` says how kernels run at a point of the program, and `choice` decides it for a
piece of work. `cache` knows what compiled code is on disk. numba is imported when the first kernel is compiled.
"""
