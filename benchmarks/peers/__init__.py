"""The paper's beam by other programs, each driven as its own users would, and tuned as an expert would.

A peer is a module with

- ``NAME``, a title, and ``LEVELS``, settings from rough to fine;
- ``missing()``: why it cannot run on this machine, or None;
- ``prepare(problem)``: what all of its runs share, which is not timed;
- ``run(problem, prepared, level)``: wall time in s and the tip's history, shape (n_times,).
"""
