"""The cases themselves, by what they are about."""
