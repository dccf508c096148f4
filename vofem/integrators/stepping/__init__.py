"""What methods that step in time share: rows, scalar laws, contact solve, records, the loop around kernels."""
