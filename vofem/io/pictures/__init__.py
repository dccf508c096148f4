"""The inner part of pictures: the shapes that are drawn, which do not depend on the backend, and the backends."""
