"""Corruptions in the order of their families, for the rows of a figure."""

from collections.abc import Iterable, Mapping, Sequence

from matplotlib.axes import Axes


def by_family(names: Iterable[str], families: Mapping[str, Sequence[str]]) -> list[tuple[str, list[str]]]:
    """Families with their members among ``names``; names in no family come last, under ``""``.

    >>> by_family(["fog", "stripe", "gaussian_noise"], {"noise": ["gaussian_noise"], "weather": ["snow", "fog"]})
    [('noise', ['gaussian_noise']), ('weather', ['fog']), ('', ['stripe'])]
    """
    found = list(names)
    groups = [(family, [name for name in members if name in found]) for family, members in families.items()]
    rest = [name for name in found if not any(name in members for members in families.values())]
    return [(family, members) for family, members in [*groups, ("", rest)] if members]


def name_family(axes: Axes, family: str, middle: float) -> None:
    """Write the name of a family upright beside the axes, at the height ``middle`` of its rows.

    >>> from sextant.figures.style import new_figure
    >>> figure, (axes,) = new_figure(3.0, 2.0)
    >>> name_family(axes, "noise", 1.5)
    >>> axes.texts[0].get_text(), axes.texts[0].get_position()
    ('noise', (1.015, 1.5))
    """
    axes.text(
        1.015,
        middle,
        family,
        transform=axes.get_yaxis_transform(),
        rotation=270,
        ha="left",
        va="center",
        fontsize=8,
        color="0.4",
    )
