"""Files of random weights in the layouts of published networks for cameras; names and shapes as their authors write
them. No real weights are here. Widths and depths are smaller than published, since the reader takes them from shapes.
"""

from models.published_places import dinov2, random_arrays

WIDTHS, DEPTHS, HAM, FINE = (8, 8, 12, 16), (1, 2, 1, 1), 16, 8


def _norm(name, width):
    running = {f"{name}.running_mean": (width,), f"{name}.running_var": (width,)}
    return {f"{name}.weight": (width,), f"{name}.bias": (width,)} | running


def _conv(name, out, into, *kernel, bias=True):
    return {f"{name}.weight": (out, into, *(kernel or (1, 1)))} | ({f"{name}.bias": (out,)} if bias else {})


def _block(name, width, hidden):
    unit = f"{name}.attn.spatial_gating_unit"
    shapes = _norm(f"{name}.norm1", width) | _norm(f"{name}.norm2", width)
    shapes |= _conv(f"{name}.attn.proj_1", width, width) | _conv(f"{name}.attn.proj_2", width, width)
    shapes |= _conv(f"{unit}.conv0", width, 1, 5, 5) | _conv(f"{unit}.conv3", width, width)
    for k, length in enumerate((7, 11, 21)):
        shapes |= _conv(f"{unit}.conv{k}_1", width, 1, 1, length) | _conv(f"{unit}.conv{k}_2", width, 1, length, 1)
    shapes |= _conv(f"{name}.mlp.fc1", hidden, width) | _conv(f"{name}.mlp.fc2", width, hidden)
    shapes |= _conv(f"{name}.mlp.dwconv.dwconv", hidden, 1, 3, 3)
    return shapes | {f"{name}.layer_scale_1": (width,), f"{name}.layer_scale_2": (width,)}


def _decoder(name, numbers):
    own = f"perspective_decoder.{name}_head.decoder"
    shapes = _conv(f"{own}.squeeze.conv", HAM, sum(WIDTHS)) | _conv(f"{own}.align.conv", FINE, HAM)
    for end in ("in", "out"):
        shapes |= _conv(f"{own}.hamburger.ham_{end}.conv", HAM, HAM)
    shapes |= _conv(f"{own}.linear_pred_uncertainty.0.conv", FINE, FINE, 3, 3, bias=False)
    shapes |= _conv(f"{own}.linear_pred_uncertainty.1", 1, FINE)
    shapes |= _conv(f"{own}.out_conv.conv", FINE, FINE, 3, 3, bias=False)
    for unit in (1, 2):
        for k in (1, 2):
            shapes |= _conv(f"{own}.ll_fusion.resConfUnit{unit}.conv{k}", FINE, FINE, 3, 3)
    return shapes | _conv(f"perspective_decoder.{name}_head.linear_pred_{name}", numbers, FINE)


def geocalib():
    """GeoCalib's state dict: encoder, map at full size, two decoders."""
    shapes = _conv("backbone.patch_embed1.proj.0", WIDTHS[0] // 2, 3, 3, 3)
    shapes |= _norm("backbone.patch_embed1.proj.1", WIDTHS[0] // 2)
    shapes |= _conv("backbone.patch_embed1.proj.3", WIDTHS[0], WIDTHS[0] // 2, 3, 3)
    shapes |= _norm("backbone.patch_embed1.proj.4", WIDTHS[0])
    for k, (width, depth) in enumerate(zip(WIDTHS, DEPTHS, strict=True)):
        if k:
            shapes |= _conv(f"backbone.patch_embed{k + 1}.proj", width, WIDTHS[k - 1], 3, 3)
            shapes |= _norm(f"backbone.patch_embed{k + 1}.norm", width)
        for n in range(depth):
            shapes |= _block(f"backbone.block{k + 1}.{n}", width, 4 * width)
        shapes |= {f"backbone.norm{k + 1}.weight": (width,), f"backbone.norm{k + 1}.bias": (width,)}
    shapes |= _conv("ll_enc.conv1.conv", FINE, 3, 3, 3) | _conv("ll_enc.conv2.conv", FINE, FINE, 3, 3)
    shapes |= _decoder("up", 2) | _decoder("latitude", 1)
    arrays = random_arrays(shapes)
    return {name: value.abs() + 0.5 if name.endswith("running_var") else value for name, value in arrays.items()}


def anycalib(width=64, channels=8):
    """AnyCalib's state dict: DINOv2, a light decoder, rays."""
    shapes = {"backbone.image_mean": (1, 3, 1, 1), "backbone.image_std": (1, 3, 1, 1)}
    for k in range(4):
        out = width // 2 ** (3 - k)
        shapes |= _conv(f"decoder.reassemble_blocks.projects.{k}", out, width)
        shapes |= _conv(f"decoder.convs.{k}", channels, out, 3, 3)
        for unit in (1, 2) if k else (2,):
            for n in (0, 2):
                shapes |= _conv(f"decoder.fusion_blocks.{k}.res_conv_unit{unit}.conv.{n}", channels, channels, 3, 3)
    shapes |= _conv("decoder.project.0", channels, channels, 3, 3)
    for head, out in (("tangent_head", 2), ("upsampling_weights_head", 9 * 7 * 7)):
        shapes |= _conv(f"head.{head}.0", channels // 2, channels, 3, 3) | _conv(f"head.{head}.2", out, channels // 2)
    return dinov2("backbone.model.", width=width, depth=4) | random_arrays(shapes)


FILES = {"geocalib": geocalib, "anycalib": anycalib}
