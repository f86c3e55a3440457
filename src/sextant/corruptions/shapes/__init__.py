"""Shapes: MNIST-C's motions of a digit, lines over it, and its edges."""
