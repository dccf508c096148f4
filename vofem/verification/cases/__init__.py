"""The cases, in a module for each subject."""
