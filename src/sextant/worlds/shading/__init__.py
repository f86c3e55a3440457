"""What is seen where a ray meets a surface: textures, light and the development of a picture, compiled to machine code.

The functions are flat: numbers in, numbers out, one function per material. ``kernels`` loops over rays; ``materials``
selects the function for a kind of surface; ``look`` turns an appearance into the numbers that all of them read.
"""
