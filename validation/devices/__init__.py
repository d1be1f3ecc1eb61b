"""Cases for a GPU that is new: the bits of the CPU, laws of conservation, and speed."""
