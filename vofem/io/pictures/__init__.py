"""Pictures from the inside: what is drawn, independent of the backend, and the backends."""
