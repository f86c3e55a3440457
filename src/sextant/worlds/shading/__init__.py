"""What is seen where a ray meets a surface: textures, light and the development of a picture, compiled to machine code.

The functions are flat: numbers in, numbers out, one function a material. ``kernels`` loops over rays; ``materials``
tells one kind of surface from the other; ``look`` turns an appearance into the numbers that all of them read.
"""
