"""The compiled functions: hashes like dice, smooth noise, exact fog, and a sensor with the noise that it states."""

import numpy as np
import pytest
from worlds.handmade import OVERCAST, box, down, floor, pinhole, pose, renderer, undeveloped

from sextant.worlds.appearance import Appearance
from sextant.worlds.renderer import gamma_curve
from sextant.worlds.shading import kernels
from sextant.worlds.shading.look import (
    BOUNCE_R,
    FOG,
    FOG_R,
    HORIZON_R,
    SUN_R,
    SUN_X,
    SUN_Z,
    ZENITH_R,
    pack,
    white_balance,
)
from sextant.worlds.shading.noise import clamp, fractal_noise, hash3, keep, smoothstep, value_noise
from sextant.worlds.shading.sky import sky
from sextant.worlds.surfaces import Kind

GREY = (0.4, 0.4, 0.4)


def hashes(i, j, k):
    return np.array([hash3(int(a), int(b), int(c)) for a, b, c in zip(*np.broadcast_arrays(i, j, k), strict=True)])


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("start", [0, -40_000, 2**24])
def test_hashes_are_uniform_along_every_axis_and_sign(axis, start):
    at = [3, -7, 11]
    at[axis] = start + np.arange(20_000)
    values = hashes(*at)
    assert values.min() >= 0
    assert values.max() < 1
    share = np.histogram(values, 20, (0, 1))[0] / 1000
    assert ((share - 1) ** 2).sum() * 1000 < 45  # chi squared with 19 degrees of freedom, 0.999 quantile 43.8
    assert abs(np.corrcoef(values[1:], values[:-1])[0, 1]) < 0.03
    assert len(np.unique(values)) > 19_990


def test_hashes_of_neighbours_and_of_opposite_signs_are_independent():
    n = np.arange(1, 8001)
    base = hashes(n, 2 * n, 5)
    for other in (
        hashes(-n, 2 * n, 5),
        hashes(n, -2 * n, 5),
        hashes(n, 2 * n, -5),
        hashes(2 * n, n, 5),
        hashes(n, 2 * n, 6),
        hashes(5, 2 * n, n),
    ):
        assert abs(np.corrcoef(base, other)[0, 1]) < 0.05


def test_value_noise_passes_through_its_lattice_and_has_no_jumps():
    for i, j in ((0, 0), (-3, 5), (17, -2)):
        assert value_noise(float(i), float(j), 9) == hash3(i, j, 9)
    s = np.linspace(-4.5, 4.5, 9001)
    line = np.array([value_noise(x, 0.37 * x - 1.2, 4) for x in s])
    assert np.abs(np.diff(line)).max() < 4 * (
        s[1] - s[0]
    )  # no steeper than 1.5 an axis, lattice lines and zero included
    assert line.std() > 0.1
    assert 0 <= line.min() < line.max() < 1


def test_fractal_noise_stays_in_its_range_and_is_finer_with_octaves():
    s = np.linspace(-20, 20, 4001)
    coarse, fine = (np.array([fractal_noise(x, 3.3, 8, n) for x in s]) for n in (1, 4))
    for line in (coarse, fine):
        assert 0 <= line.min() < line.max() < 1
    assert np.abs(np.diff(fine)).mean() > 1.2 * np.abs(np.diff(coarse)).mean()
    assert fractal_noise(1.5, 2.5, 3, 1) == value_noise(1.5, 2.5, 3)


def test_small_functions():
    assert [clamp(x, 0.0, 1.0) for x in (-1.0, 0.3, 7.0)] == [0, 0.3, 1]
    assert [smoothstep(2.0, 4.0, x) for x in (1.0, 2.0, 3.0, 4.0, 9.0)] == [0, 0, 0.5, 1, 1]
    assert keep(0.0, 1.0) == 1.0
    assert keep(5.0, 1.0) == 0.0


# -- light -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("beta", [0.005, 0.04])
def test_fog_takes_light_away_exponentially(beta):
    rays, eye = pinhole(60, 40, 60), pose(0, 0, 30)
    drawer = renderer(floor(8000, colour=GREY), box((25, 4, 0), (4, 4, 35), colour=(0.9, 0.1, 0.1)))
    clear, foggy = (drawer.view(rays, eye, Appearance(fog_per_m=b)) for b in (0.0, beta))
    fog = pack(Appearance())[FOG_R : FOG_R + 3]
    near = np.isfinite(clear.distance_m) & (clear.distance_m < 3 / beta)
    expected = (clear.radiance - fog) * np.exp(-beta * clear.distance_m)[..., None]
    assert near.sum() > 200
    assert np.abs((foggy.radiance - fog - expected)[near]).max() < 1e-5
    far = np.isfinite(clear.distance_m) & (clear.distance_m > 7 / beta)
    assert far.any()
    assert np.abs(foggy.radiance[far] - fog).max() < 0.01
    assert pack(Appearance())[FOG] < 5e-4  # clear air is nearly clear


def test_snow_covers_what_faces_up_and_leaves_walls_their_colour():
    dark = (0.05, 0.06, 0.04)
    drawer = renderer(floor(500, colour=dark), box((12, 0, 0), (2, 8, 5), colour=dark))
    rays, eye = pinhole(61, 41, 60), pose(0, 0, 1.6)
    bare, snowy = (drawer.view(rays, eye, Appearance(snow=s, cloud_cover=1.0)) for s in (0.0, 0.95))
    ground = (bare.surface == 0) & (bare.distance_m < 30)
    wall = bare.surface == 1
    assert np.median(snowy.radiance[ground] / bare.radiance[ground]) > 5
    # a wall gets more light from the snow below, by the half of the bounce, and nothing else
    a, b = (pack(Appearance(snow=s, cloud_cover=1.0)) for s in (0.0, 0.95))
    air = 0.5 * (a[ZENITH_R : ZENITH_R + 3] + a[HORIZON_R : HORIZON_R + 3])
    more = (snowy.radiance - bare.radiance)[wall]
    gain = 0.5 * (b - a)[BOUNCE_R : BOUNCE_R + 3] * dark
    assert more == pytest.approx(np.tile(gain, (wall.sum(), 1)), rel=0.1)
    assert (0.5 * air).min() > 0


def test_wet_ground_darkens():
    drawer = renderer(floor(50, colour=GREY))
    rays = pinhole(31, 31, 40)
    dry, damp, wet = (
        drawer.view(rays, down(0, 0, 9), Appearance(wetness=w, cloud_cover=1.0)).radiance.mean()
        for w in (0.0, 0.5, 1.0)
    )
    assert wet < 0.75 * dry
    assert wet < damp < dry
    assert wet > 0.3 * dry


def test_a_wall_in_the_sun_obeys_lamberts_law():
    level = [
        renderer(floor(50, colour=GREY)).view(pinhole(9, 9, 5), down(0, 0, 9), look).radiance.mean((0, 1))
        for look in (Appearance(sun_elevation_deg=90, cloud_cover=0), Appearance(sun_elevation_deg=90, cloud_cover=1.0))
    ]
    assert level[0].mean() > 2 * level[1].mean()
    for elevation in (30.0, 60.0):
        look = Appearance(sun_elevation_deg=elevation, cloud_cover=0.0)
        table = pack(look)
        sun = table[SUN_R : SUN_R + 3] * table[SUN_Z]
        assert table[SUN_Z] == pytest.approx(np.sin(np.radians(elevation)))
        lit = renderer(floor(50, colour=GREY)).view(pinhole(1, 1, 5), down(0, 0, 9), look).radiance[0, 0]
        tent = renderer(floor(50, colour=GREY), floor(40, z=20.0, kind=Kind.PLAIN))
        shaded = tent.view(pinhole(1, 1, 5), down(0, 0, 9), look).radiance[0, 0]
        assert (lit - shaded) / GREY == pytest.approx(sun, rel=0.1)  # a plain surface varies by six per cent


def test_the_sun_sets_and_clouds_hide_it():
    assert pack(Appearance(sun_elevation_deg=-20))[SUN_R] == 0
    assert pack(Appearance(cloud_cover=1.0))[SUN_R] == 0
    assert pack(Appearance(sun_elevation_deg=10))[SUN_R] > pack(Appearance(sun_elevation_deg=10))[SUN_R + 2]  # low: red
    look = pack(Appearance(sun_azimuth_deg=90.0))
    assert look[SUN_X : SUN_Z + 1] == pytest.approx([0, np.cos(np.radians(52)), np.sin(np.radians(52))], abs=1e-12)
    assert not pack(Appearance()).flags.writeable


def test_the_sky_is_finite_everywhere_and_brightest_at_the_sun():
    rng = np.random.default_rng(0)
    for look in (Appearance(), Appearance(sun_elevation_deg=-30, night=1), OVERCAST):
        table = pack(look)
        ways = rng.normal(size=(2000, 3))
        ways /= np.linalg.norm(ways, axis=1, keepdims=True)
        colours = np.array([sky(*way, table, True) for way in np.concatenate([ways, np.eye(3), -np.eye(3)])])
        assert np.isfinite(colours).all()
        assert colours.min() >= 0
    table = pack(Appearance())
    assert min(sky(*table[SUN_X : SUN_Z + 1], table, True)) > 5


# -- the sensor --------------------------------------------------------------------------------------------------------


def develop(radiance, *, width=None, look=None, seed=0, gain=None):
    """A picture of a table of radiance, with unit gain and a straight curve unless the look says otherwise."""
    look = look or Appearance(gamma=1.0)
    linear = np.repeat(np.asarray(radiance, np.float32)[..., None], 3, -1).reshape(-1, 3)
    out = np.empty(linear.shape, np.uint8)
    gain = np.ones(3) if gain is None else gain
    kernels.develop(
        linear,
        width or len(linear),
        gain,
        gamma_curve(look.gamma),
        look.read_noise,
        look.shot_noise,
        look.vignetting,
        seed,
        out,
    )
    return out


def test_the_shoulder_rises_and_keeps_black_black():
    level = np.linspace(0, 12, 4000)
    out = develop(level).astype(int)[:, 0]
    assert out[0] == 0
    assert (np.diff(out) >= 0).all()
    assert out[-1] == 255
    middle = 2.51 * 0.25 + 0.03
    assert out[np.argmin(abs(level - 0.25))] == pytest.approx(
        255 * 0.25 * middle / (0.25 * (2.43 * 0.25 + 0.59) + 0.14), abs=1
    )


@pytest.mark.parametrize(("read", "shot", "level"), [(0.05, 0.0, 0.2), (0.0, 0.1, 0.2), (0.03, 0.08, 0.12)])
def test_noise_has_the_sigma_that_it_states(read, shot, level):
    grey = np.full((200, 200), level)
    mean = develop(grey)[0, 0] / 255
    noisy = develop(grey, width=200, look=Appearance(gamma=1.0, read_noise=read, shot_noise=shot), seed=5) / 255
    assert noisy.std() == pytest.approx(np.sqrt(read**2 + shot**2 * mean), rel=0.03)
    assert noisy.mean() == pytest.approx(mean, abs=0.003)
    r, g, b = (noisy - mean).reshape(200, 200, 3).transpose(2, 0, 1)
    for one, other in ((r, g), (g, b), (r, b), (r[1:], r[:-1]), (r[:, 1:], r[:, :-1])):
        assert abs(np.corrcoef(one.ravel(), other.ravel())[0, 1]) < 0.03
    again = develop(grey, width=200, look=Appearance(gamma=1.0, read_noise=read, shot_noise=shot), seed=6) / 255
    assert abs(np.corrcoef(noisy.ravel(), again.ravel())[0, 1]) < 0.02


def test_vignetting_takes_its_share_from_the_corners():
    drawer = renderer(floor(500, colour=GREY))
    rays = pinhole(80, 60, 4)  # a narrow view: all of one light
    plain, dim = (
        undeveloped(
            drawer.picture(rays, down(0, 0, 1), Appearance(gamma=1.0, vignetting=v, cloud_cover=1.0)).astype(float)
        )
        for v in (0.0, 0.6)
    )
    share = (dim / plain).mean(-1)
    assert share[28:32, 38:42].mean() == pytest.approx(1.0, abs=0.02)
    corner = (share[0, 0] + share[-1, -1] + share[0, -1] + share[-1, 0]) / 4
    assert corner == pytest.approx(0.4, abs=0.04)
    assert share[30, 0] == pytest.approx(1 - 0.6 * 40**2 / 50**2, abs=0.04)


def test_a_stop_doubles_the_light_before_the_tone_curve():
    drawer = renderer(floor(500, colour=(0.1,) * 3))
    rays = pinhole(20, 15, 30)
    dark, bright = (
        undeveloped(drawer.picture(rays, down(0, 0, 5), Appearance(gamma=1.0, exposure_ev=ev)).astype(float))
        for ev in (0.0, 1.0)
    )
    assert bright.mean() / dark.mean() == pytest.approx(2.0, rel=0.02)
    view = drawer.view(rays, down(0, 0, 5), Appearance())
    assert dark == pytest.approx(view.radiance, rel=0.08)


def test_gamma_is_a_power_of_the_developed_light():
    drawer, rays = renderer(floor(500, colour=GREY)), pinhole(20, 15, 30)
    straight, curved = (
        drawer.picture(rays, down(0, 0, 5), Appearance(gamma=g, cloud_cover=1.0)).astype(float) / 255
        for g in (1.0, 2.2)
    )
    assert curved == pytest.approx(straight ** (1 / 2.2), abs=0.006)


def test_white_balance_is_neutral_at_6500_and_warm_below():
    assert white_balance(6500.0).tolist() == [1, 1, 1]
    warm, cold = white_balance(4000.0), white_balance(9000.0)
    assert warm[0] > 1 > warm[2]
    assert cold[0] < 1 < cold[2]
    grey = np.full(10, 0.2)
    assert np.ptp(develop(grey, gain=white_balance(6500.0))[0]) == 0
    r, _, b = develop(grey, gain=white_balance(3500.0))[0].astype(int)
    assert r > b + 10
