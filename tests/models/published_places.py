"""Files of random weights in the layouts of published place networks; names and shapes as their authors write them.

No real weights are here. Depths are smaller than published where the layout allows, for speed; widths are not.
"""

import torch


def of_module(module, prefix):
    return {prefix + name: value for name, value in module.state_dict().items()}


def dinov2(prefix, *, width=768, depth=1, side=37, registers=0, gated=0, generator=None):
    """The state dict of facebookresearch/dinov2's ViT at 518 pixels; ViT-g has gated layers."""
    shapes = {
        "cls_token": (1, 1, width),
        "pos_embed": (1, side * side + 1, width),
        "mask_token": (1, width),
        "patch_embed.proj.weight": (width, 3, 14, 14),
        "patch_embed.proj.bias": (width,),
        "norm.weight": (width,),
        "norm.bias": (width,),
    }
    block = {
        "norm1.weight": (width,), "norm1.bias": (width,), "attn.qkv.weight": (3 * width, width),
        "attn.qkv.bias": (3 * width,), "attn.proj.weight": (width, width), "attn.proj.bias": (width,),
        "ls1.gamma": (width,), "norm2.weight": (width,), "norm2.bias": (width,),
        "mlp.fc1.weight": (4 * width, width), "mlp.fc1.bias": (4 * width,),
        "mlp.fc2.weight": (width, 4 * width), "mlp.fc2.bias": (width,), "ls2.gamma": (width,),
    }  # fmt: skip
    if registers:
        shapes["register_tokens"] = (1, registers, width)
    if gated:
        block = {name: shape for name, shape in block.items() if ".fc" not in name} | {
            "mlp.w12.weight": (gated, width), "mlp.w12.bias": (gated,),
            "mlp.w3.weight": (width, gated // 2), "mlp.w3.bias": (width,),
        }  # fmt: skip
    shapes |= {f"blocks.{k}.{name}": shape for k in range(depth) for name, shape in block.items()}
    return random_arrays({prefix + name: shape for name, shape in shapes.items()}, generator)


def random_arrays(shapes, generator=None):
    return {name: 0.05 * torch.randn(shape, generator=generator) for name, shape in shapes.items()}


def resnet(blocks, bottleneck):
    """torchvision's ResNet with as many blocks in each stage."""
    from torchvision.models.resnet import BasicBlock, Bottleneck, ResNet

    return ResNet(Bottleneck if bottleneck else BasicBlock, blocks)


def in_sequence(network, prefix, stages):
    """A ResNet's children in a sequence: stem, then layer1 from place 4 on."""
    names = ["conv1", "bn1", "relu", "maxpool", *(f"layer{k + 1}" for k in range(stages))]
    parts = [of_module(getattr(network, name), f"{prefix}{k}.") for k, name in enumerate(names)]
    return {name: value for part in parts for name, value in part.items()}


def boq_aggregator(prefix, channels, width, rows, queries=64, layers=2):
    shapes = {
        "proj_c.weight": (width, channels, 3, 3), "proj_c.bias": (width,),
        "norm_input.weight": (width,), "norm_input.bias": (width,),
        "fc.weight": (rows, layers * queries), "fc.bias": (rows,),
    }  # fmt: skip
    attention = {
        "in_proj_weight": (3 * width, width), "in_proj_bias": (3 * width,),
        "out_proj.weight": (width, width), "out_proj.bias": (width,),
    }  # fmt: skip
    for k in range(layers):
        own = {"queries": (1, queries, width)}
        for part in ("encoder.self_attn", "self_attn", "cross_attn"):
            own |= {f"{part}.{name}": shape for name, shape in attention.items()}
        for norm in ("encoder.norm1", "encoder.norm2", "norm_q", "norm_out"):
            own |= {f"{norm}.weight": (width,), f"{norm}.bias": (width,)}
        own |= {
            "encoder.linear1.weight": (4 * width, width), "encoder.linear1.bias": (4 * width,),
            "encoder.linear2.weight": (width, 4 * width), "encoder.linear2.bias": (width,),
        }  # fmt: skip
        shapes |= {f"boqs.{k}.{name}": shape for name, shape in own.items()}
    return random_arrays({prefix + name: shape for name, shape in shapes.items()})


def salad_aggregator(prefix, channels, cluster_width, hidden=512, clusters=64, token=256):
    shapes = {
        "token_features.0.weight": (hidden, channels), "token_features.0.bias": (hidden,),
        "token_features.2.weight": (token, hidden), "token_features.2.bias": (token,), "dust_bin": (),
    }  # fmt: skip
    for part, out in (("cluster_features", cluster_width), ("score", clusters)):
        shapes |= {
            f"{part}.0.weight": (hidden, channels, 1, 1), f"{part}.0.bias": (hidden,),
            f"{part}.3.weight": (out, hidden, 1, 1), f"{part}.3.bias": (out,),
        }  # fmt: skip
    return random_arrays({prefix + name: shape for name, shape in shapes.items()})


def mixvpr_aggregator(prefix, channels=1024, cells=400, out=1024, rows=4, depth=4):
    shapes = {
        "channel_proj.weight": (out, channels), "channel_proj.bias": (out,),
        "row_proj.weight": (rows, cells), "row_proj.bias": (rows,),
    }  # fmt: skip
    for k in range(depth):
        shapes |= {
            f"mix.{k}.mix.0.weight": (cells,), f"mix.{k}.mix.0.bias": (cells,),
            f"mix.{k}.mix.1.weight": (cells, cells), f"mix.{k}.mix.1.bias": (cells,),
            f"mix.{k}.mix.3.weight": (cells, cells), f"mix.{k}.mix.3.bias": (cells,),
        }  # fmt: skip
    return random_arrays({prefix + name: shape for name, shape in shapes.items()})


def vgg16(prefix):
    from torchvision.models.vgg import cfgs, make_layers

    return of_module(make_layers(cfgs["D"])[:-2], prefix)


def gem_head(channels, dimension):
    head = {"aggregation.3.weight": (dimension, channels), "aggregation.3.bias": (dimension,)}
    return {"aggregation.1.p": torch.full((1,), 3.0)} | random_arrays(head)


def megaloc(depth=1, prefix="backbone."):
    last = {"aggregator.linear.weight": (8448, 64 * 256 + 256), "aggregator.linear.bias": (8448,)}
    return dinov2(prefix, depth=depth) | salad_aggregator("aggregator.agg.", 768, 256) | random_arrays(last)


def netvlad(clusters=64, whitened=None):
    shapes = {"pool.conv.weight": (clusters, 512, 1, 1), "pool.centroids": (clusters, 512)}
    if whitened:
        shapes |= {"WPCA.0.weight": (whitened, clusters * 512, 1, 1), "WPCA.0.bias": (whitened,)}
    return vgg16("encoder.") | random_arrays(shapes)


#: name -> (state dict, kind, length of a descriptor, height and width of images)
FILES = {
    "boq_dinov2": (
        lambda: dinov2("backbone.dino.") | boq_aggregator("aggregator.", 768, 384, 32),
        "BoQ", 12288, (322, 322),
    ),
    "boq_resnet50": (
        lambda: in_sequence(resnet([1, 1, 1, 1], True), "backbone.net.", 3)
        | boq_aggregator("aggregator.", 1024, 512, 32),
        "BoQ", 16384, (384, 384),
    ),
    "salad": (
        lambda: dinov2("backbone.model.") | salad_aggregator("aggregator.", 768, 128),
        "SALAD", 8448, (322, 322),
    ),
    "salad_with_registers": (
        lambda: dinov2("backbone.model.", registers=4) | salad_aggregator("aggregator.", 768, 128),
        "SALAD", 8448, (322, 322),
    ),
    "salad_of_vit_g": (
        lambda: dinov2("backbone.model.", width=1536, gated=8192) | salad_aggregator("aggregator.", 1536, 128),
        "SALAD", 8448, (322, 322),
    ),
    "megaloc": (megaloc, "MegaLoc", 8448, (322, 322)),
    "megaloc_of_the_first_release": (lambda: megaloc(prefix="backbone.model."), "MegaLoc", 8448, (322, 322)),
    "mixvpr": (
        lambda: {
            name: value
            for name, value in of_module(resnet([1, 1, 1, 1], True), "backbone.model.").items()
            if ".layer4." not in name and ".fc." not in name
        } | mixvpr_aggregator("aggregator."),
        "MixVPR", 4096, (320, 320),
    ),
    "cosplace_resnet18": (
        lambda: in_sequence(resnet([2, 2, 2, 2], False), "backbone.", 4) | gem_head(512, 512),
        "CosPlace or EigenPlaces", 512, (480, 640),
    ),
    "eigenplaces_resnet50": (
        lambda: in_sequence(resnet([1, 1, 1, 1], True), "backbone.", 4) | gem_head(2048, 2048),
        "CosPlace or EigenPlaces", 2048, (480, 640),
    ),
    "eigenplaces_vgg16": (lambda: vgg16("backbone.") | gem_head(512, 512), "CosPlace or EigenPlaces", 512, (480, 640)),
    "netvlad": (netvlad, "NetVLAD", 32768, (480, 640)),
    "patch_netvlad": (lambda: netvlad(clusters=16, whitened=512), "NetVLAD", 512, (480, 640)),
}  # fmt: skip
