"""Filters with the constants of published work.

Sources: bifurcations of vessels, symbols - Azzopardi and Petkov 2013 and the MATLAB programs of its authors; digits -
the same paper's scheme, with the constants of a public port (COSFIRE/COSFIRE, ``parametros6``); traffic signs - the
same port (``parametros3``); vessels - Azzopardi et al. 2015, for the sets DRIVE and HRF.
"""

from collections.abc import Callable

from sextant.layers.cosfire.banks import DoGBank, GaborBank
from sextant.layers.cosfire.blur import Blur
from sextant.layers.cosfire.cosfire import Cosfire
from sextant.layers.cosfire.strategies import ConcentricCircles
from sextant.layers.cosfire.tolerance import Tolerance


def _bifurcation() -> Cosfire:
    return Cosfire(
        GaborBank(wavelengths=(4.0, 4 * 2**0.5), orientations=8),
        ConcentricCircles(radii=(0, 4, 9, 15, 22), t2=0.75),
        blur=Blur(0.67, 0.1),
        tolerance=Tolerance(rotations=16, scales=(2**-0.5, 1.0, 2**0.5), reflection=True),
        t1=0.2,
        t3=0.75,
    )


def _symbol() -> Cosfire:
    return Cosfire(
        GaborBank(wavelengths=(4 * 2**0.5, 8.0, 8 * 2**0.5), orientations=8),
        ConcentricCircles(radii=(0, 10, 25, 45), t2=0.75),
        blur=Blur(5.0, 0.1),
        tolerance=Tolerance(rotations=16, reflection=True),
    )


def _digit() -> Cosfire:
    return Cosfire(
        GaborBank(wavelengths=(2 * 2**0.5,), orientations=16, phase_deg=90.0),
        ConcentricCircles(radii=(0, 3, 8), t2=0.75),
        blur=Blur(0.83, 0.1),
        t1=0.05,
    )


def _traffic_sign() -> Cosfire:
    return Cosfire(
        GaborBank(wavelengths=(4.0,), orientations=8),
        ConcentricCircles(radii=(0, 2, 4, 7, 10, 13, 16, 20, 25), t2=0.75),
        blur=Blur(0.67, 0.04),
        t1=0.1,
        t3=0.99,
    )


def _vessels(sigma: float, radii: tuple[int, ...], sigma0: float, alpha: float, rotations: int, span: float) -> Cosfire:
    # published constants of the blur are divided by six in every program
    return Cosfire(
        DoGBank(sigmas=(sigma,), border="zeros"),
        ConcentricCircles(radii=tuple(map(float, radii)), t2=0.4, apart_deg=150.0),
        blur=Blur(sigma0 / 6, alpha / 6, kind="sum"),
        least_weight=1.0,
        tolerance=Tolerance(rotations=rotations, span_deg=span),
        border="circular",
    )


#: name -> function that builds its filters, not configured yet
PRESETS: dict[str, Callable[[], Cosfire]] = {
    "bifurcation": _bifurcation,
    "symbol": _symbol,
    "digit": _digit,
    "traffic_sign": _traffic_sign,
    "vessel_drive": lambda: _vessels(2.4, (0, 2, 4, 6, 8), 3.0, 0.7, 12, 180.0),
    "vessel_end_drive": lambda: _vessels(1.8, tuple(range(0, 23, 2)), 2.0, 0.1, 24, 360.0),
    "vessel_hrf": lambda: _vessels(3.2, (0, 2, 4, 6, 8), 3.0, 0.3, 12, 180.0),
    "vessel_end_hrf": lambda: _vessels(2.7, tuple(range(0, 14, 2)), 1.0, 0.1, 24, 360.0),
}


def preset(name: str) -> Cosfire:
    """Filters of a published application, to be configured from an example.

    >>> preset("digit").bank.__class__.__name__
    'GaborBank'

    Raises:
        ValueError: there is no preset of that name.
    """
    if name not in PRESETS:
        raise ValueError(f"there is no COSFIRE preset {name!r}; choose among {', '.join(PRESETS)}")
    return PRESETS[name]()
