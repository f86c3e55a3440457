import math
import time
from dataclasses import replace

import numpy as np
import pytest
import torch
from jaxtyping import TypeCheckError
from scipy import integrate, stats
from worlds.casters import Boxes

from sextant.errors import UserError
from sextant.localization.laser import BeamModel, LikelihoodField
from sextant.localization.laser.scan_evidence import ScanEvidence, chosen_beams, chosen_ranges
from sextant.worlds.laser import LaserScanner, scan
from sextant.worlds.occupancy import FREE, OCCUPIED, UNKNOWN, OccupancyGrid, occupancy_from_scene

ONE_BEAM = LaserScanner(beams=1, max_range_m=10.0, range_sigma_m=0.0)
SCANNER = LaserScanner(beams=181, field_of_view_rad=np.pi, max_range_m=12.0, range_sigma_m=0.01)
#: An L-shaped room: no symmetry takes it to itself.
ROOM = Boxes((0.0, 0.0, 9.0, 5.0), (5.0, 3.0, 9.0, 5.0), (2.0, 3.5, 2.5, 5.0))
GRID = occupancy_from_scene(ROOM, (-0.5, -0.5, 9.5, 5.5), 0.3, 0.05)
NOWHERE = torch.zeros(1, 3, dtype=torch.float64)
MODELS = [
    LikelihoodField(GRID, SCANNER),
    LikelihoodField(GRID, SCANNER, unknown="distance"),
    BeamModel(GRID, SCANNER),
]


def wall_grid(unknown_from=None):
    """A corridor of 12 cells of 0.5 m with a wall in cell 8, whose centre is at 4.25 m."""
    cells = np.full((1, 12), FREE, np.uint8)
    cells[0, 8] = OCCUPIED
    if unknown_from is not None:
        cells[0, unknown_from:] = UNKNOWN
    return OccupancyGrid(cells, 0.5, (0.0, -0.25))


def score(model, ranges, *poses):
    scans = torch.tensor(ranges, dtype=torch.float64).reshape(1, -1)
    return model.observe(scans, NOWHERE).log_likelihood(torch.tensor(poses, dtype=torch.float64)[None])[0].numpy()


def scans_at(*poses, seed=0):
    return torch.from_numpy(scan(SCANNER, ROOM, np.array(poses), np.random.default_rng(seed)))


class TestField:
    def test_one_beam_by_hand(self):
        field = LikelihoodField(wall_grid(), ONE_BEAM, sigma_m=0.5, z_hit=0.7, z_rand=0.3, max_distance_m=2.0)
        ends = [2.75, 3.75, 4.25, 5.0]  # the first two and the last are 1.5, 0.5 and 1 m from the wall's cell
        found = [score(field, [end - 0.1], (0.1, 0.0, 0.0))[0] for end in ends]
        expected = [math.log(0.7 * math.exp(-(d**2) / (2 * 0.25)) + 0.3 / 10) for d in (1.5, 0.5, 0.0, 1.0)]
        np.testing.assert_allclose(found, expected, rtol=1e-6)

    def test_far_outside_and_unknown_ends_are_random(self):
        random = math.log(0.5 / 10)
        near = LikelihoodField(wall_grid(), ONE_BEAM, max_distance_m=1.0)
        assert score(near, [2.0], (0.1, 0.0, 0.0))[0] == pytest.approx(random)
        assert score(near, [9.0], (0.1, 0.0, 0.0))[0] == pytest.approx(random)
        assert score(near, [1.0], (0.1, 0.0, math.pi))[0] == pytest.approx(random)
        assert score(near, [1.0], (float("nan"), 0.0, 0.0))[0] == pytest.approx(random)
        as_amcl, as_random = (LikelihoodField(wall_grid(9), ONE_BEAM, unknown=way) for way in ("distance", "random"))
        assert score(as_random, [4.6], (0.1, 0.0, 0.0))[0] == pytest.approx(random)
        assert score(as_amcl, [4.6], (0.1, 0.0, 0.0))[0] == pytest.approx(
            math.log(0.5 * math.exp(-(0.5**2) / 0.08) + 0.05), rel=1e-6
        )

    @pytest.mark.parametrize("nothing", [10.0, 11.0, math.inf, math.nan])
    def test_a_beam_without_return_says_nothing(self, nothing):
        assert score(LikelihoodField(wall_grid(), ONE_BEAM), [nothing], (0.1, 0.0, 0.0))[0] == 0

    def test_it_equals_a_slow_loop_over_beams(self):
        field = LikelihoodField(GRID, SCANNER, sigma_m=0.15, z_hit=0.8, z_rand=0.2, tempering=0.3, beams=25)
        rng = np.random.default_rng(1)
        scans = scans_at((1.0, 1.0, 0.3), (7.0, 2.0, 2.0))
        scans[:, ::7] = SCANNER.max_range_m
        poses = rng.uniform((-1, -1, -4), (10, 6, 4), (2, 40, 3))
        distance, chosen = GRID.distance_m(), chosen_beams(SCANNER, 25)
        expected = np.zeros((2, 40))
        for run in range(2):
            for particle, (x, y, heading) in enumerate(poses[run]):
                for beam in chosen:
                    reading, angle = float(scans[run, beam]), heading + SCANNER.angles[beam]
                    if reading >= SCANNER.max_range_m:
                        continue
                    end = np.array([x + reading * math.cos(angle), y + reading * math.sin(angle)])
                    row, column = GRID.world_to_cell(end)
                    inside = bool(GRID.contains(np.array([row, column])))
                    d = distance[row, column] if inside else math.inf
                    hit = 0.8 * math.exp(-(d**2) / (2 * 0.15**2)) if d <= 2 else 0.0
                    expected[run, particle] += 0.3 * math.log(hit + 0.2 / SCANNER.max_range_m)
        found = field.observe(scans, NOWHERE).log_likelihood(torch.from_numpy(poses))
        np.testing.assert_allclose(found.numpy(), expected, rtol=1e-5)

    def test_a_thousand_particles_take_milliseconds(self):
        field = LikelihoodField(GRID, SCANNER)
        rng = np.random.default_rng(0)
        poses = torch.from_numpy(rng.uniform((0, 0, -3), (9, 5, 3), (1, 1000, 3)))
        scans = scans_at((1.0, 1.0, 0.3))
        field.observe(scans, NOWHERE).log_likelihood(poses)
        took = []
        for _ in range(20):
            start = time.perf_counter()
            field.observe(scans, NOWHERE).log_likelihood(poses)
            took.append(time.perf_counter() - start)
        assert min(took) < 0.02  # 0.3 ms was measured


class TestBeam:
    def test_the_density_integrates_to_one(self):
        model = BeamModel(GRID, SCANNER, 0.6, 0.2, 0.1, 0.3, sigma_hit=0.3, lambda_short=0.5)
        for wanted in (0.2, 3.0, 11.9, SCANNER.max_range_m):
            expected = np.array([[wanted]])

            def density(z, expected=expected):
                return float(model.density(np.array([z]), expected)[0, 0])

            points = [wanted, max(wanted - 1, 0), min(wanted + 1, 12)]
            mass = integrate.quad(density, 0, SCANNER.max_range_m, points=points, limit=200)[0]
            atom = 0.1 / 1.2  # nothing came back
            assert mass + atom == pytest.approx(1, abs=1e-6)

    def test_one_beam_by_hand(self):
        model = BeamModel(wall_grid(), ONE_BEAM, 0.4, 0.1, 0.2, 0.3, sigma_hit=0.5, lambda_short=0.3)
        wanted = 4.25 - 0.1  # to the middle of the wall's cell
        for reading in (2.0, 4.0, 5.0):
            hit = stats.truncnorm.pdf(reading, -wanted / 0.5, (10 - wanted) / 0.5, wanted, 0.5)
            short = 0.3 * math.exp(-0.3 * reading) / (1 - math.exp(-0.3 * wanted)) if reading <= wanted else 0
            expected = math.log(0.4 * hit + 0.1 * short + 0.3 / 10)
            assert score(model, [reading], (0.1, 0.0, 0.0))[0] == pytest.approx(expected)
        hit = stats.truncnorm.pdf(10.0, -wanted / 0.5, (10 - wanted) / 0.5, wanted, 0.5)
        assert score(model, [10.0], (0.1, 0.0, 0.0))[0] == pytest.approx(math.log(0.4 * hit + 0.2))

    def test_without_a_known_range_what_needs_none_remains(self):
        model = BeamModel(wall_grid(5), ONE_BEAM, 0.4, 0.1, 0.2, 0.3)
        for pose in ((0.1, 0.0, 0.0), (0.1, 0.0, math.pi), (-4.0, 0.0, 0.0)):
            assert score(model, [2.0], pose)[0] == pytest.approx(math.log(0.3 / 10))
            assert score(model, [math.nan], pose)[0] == pytest.approx(math.log(0.2))

    def test_within_a_wall_no_density_is_infinite(self):
        model = BeamModel(wall_grid(), ONE_BEAM, lambda_short=5.0)
        with np.errstate(all="raise", under="ignore"):
            values = model.density(np.array([0.0, 0.1, 3.0, np.inf]), np.zeros((1, 4)))
        assert np.isfinite(values).all()
        assert values.max() < 10  # a cell is half a metre
        for pose in ((4.0, 0.0, 0.0), (4.5, 0.25, math.pi), (4.2, 0.1, 1.0)):
            assert np.isfinite(score(model, [0.0], pose)).all()

    def test_it_does_not_see_through_walls_as_the_field_does(self):
        """Between two walls, a scan of the wall behind the nearer one fits the field as well, the beam model not."""
        cells = np.full((1, 40), FREE, np.uint8)
        cells[0, [10, 30]] = OCCUPIED
        grid = OccupancyGrid(cells, 0.1, (0.0, -0.05))
        field, beam = LikelihoodField(grid, ONE_BEAM), BeamModel(grid, ONE_BEAM)
        near, behind = 1.05 - 0.3, 3.05 - 0.3
        assert score(field, [near], (0.3, 0.0, 0.0)) == pytest.approx(score(field, [behind], (0.3, 0.0, 0.0)))
        assert score(beam, [near], (0.3, 0.0, 0.0))[0] > score(beam, [behind], (0.3, 0.0, 0.0))[0] + 2

    def test_beams_need_not_end_before_the_map_nor_weights_sum_to_one(self):
        scans, pose = scans_at((1.0, 1.0, 0.3)), torch.tensor([[[1.0, 1.0, 0.3]]]).double()
        for model in (
            BeamModel(GRID, SCANNER, z_hit=1.0, z_short=0),
            LikelihoodField(GRID, SCANNER, z_hit=0, z_rand=2),
        ):
            assert model.observe(scans, NOWHERE).log_likelihood(pose).isfinite().all()


@pytest.mark.parametrize("model", MODELS, ids=["field", "field as AMCL", "beam"])
class TestBoth:
    TRUTH = (1.3, 1.1, 0.4)

    def test_no_pose_in_the_room_is_likelier_than_the_true_one(self, model):
        x, y, heading = np.meshgrid(
            np.arange(0.3, 9, 0.5), np.arange(0.1, 5, 0.5), np.arange(-np.pi, np.pi, np.pi / 12), indexing="ij"
        )
        everywhere = np.column_stack([x.ravel(), y.ravel(), heading.ravel()])
        poses = torch.from_numpy(np.concatenate([[self.TRUTH], everywhere]))[None]
        values = model.observe(scans_at(self.TRUTH), NOWHERE).log_likelihood(poses)[0].numpy()
        away = np.hypot(*(everywhere[:, :2] - self.TRUTH[:2]).T)
        assert values[0] > values[1:][away > 0.5].max() + 10
        best = everywhere[values[1:].argmax()]
        assert np.hypot(*(best[:2] - self.TRUTH[:2])) <= 0.5

    @pytest.mark.parametrize("axis", [0, 1, 2])
    def test_it_falls_off_on_both_sides_of_the_truth(self, model, axis):
        offsets = np.array([-0.8, -0.4, -0.1, 0.0, 0.1, 0.4, 0.8])
        poses = np.tile(self.TRUTH, (len(offsets), 1))
        poses[:, axis] += offsets
        values = model.observe(scans_at(self.TRUTH), NOWHERE).log_likelihood(torch.from_numpy(poses)[None])[0].numpy()
        assert values[3] > values[[0, 1, 5, 6]].max()
        assert values[[2, 3, 4]].min() > values[[0, 6]].max()

    def test_runs_have_scans_of_their_own_and_share_the_map(self, model):
        poses = torch.tensor([self.TRUTH, (7.0, 1.5, 2.0), (4.0, 2.5, -1.0)], dtype=torch.float64)
        scans = scans_at(*poses.tolist())
        over = model.observe(scans, poses).over_map()
        assert over.shape == (3, 3)
        assert over.argmax(dim=1).tolist() == [0, 1, 2]
        each = model.observe(scans, poses).log_likelihood(poses.expand(3, 3, 3).clone())
        torch.testing.assert_close(over, each)
        alone = model.observe(scans[1:2], poses).over_map()
        torch.testing.assert_close(over[1:2], alone)

    def test_tempering_multiplies_logarithms_of_ratios(self, model):
        poses = torch.tensor([[self.TRUTH, (7.0, 1.5, 2.0)]], dtype=torch.float64)
        scans = scans_at(self.TRUTH)
        full = model.observe(scans, NOWHERE).log_likelihood(poses)
        quarter = replace(model, tempering=0.25).observe(scans, NOWHERE).log_likelihood(poses)
        torch.testing.assert_close(quarter, full / 4)

    def test_scans_of_another_scanner_are_refused(self, model):
        with pytest.raises(ValueError, match="scans have 7 beams, the scanner has 181"):
            model.observe(torch.ones(1, 7, dtype=torch.float64), NOWHERE)
        with pytest.raises(ValueError, match="range is negative"):
            model.observe(torch.full((1, 181), -1.0, dtype=torch.float64), NOWHERE)

    @pytest.mark.parametrize(("runs", "scans"), [(3, 1), (1, 3), (2, 3)])
    def test_poses_of_more_or_fewer_runs_are_refused(self, model, runs, scans):
        evidence = model.observe(scans_at(*[self.TRUTH] * scans), NOWHERE)
        with pytest.raises(UserError, match=rf"poses of {runs} runs? for {scans} scans?"):
            evidence.log_likelihood(NOWHERE.expand(runs, 1, 3))

    def test_scans_and_poses_of_the_map_are_rows(self, model):
        for scans, poses in ((scans_at(self.TRUTH)[0], NOWHERE), (scans_at(self.TRUTH), NOWHERE[:, :2])):
            with pytest.raises((UserError, TypeCheckError), match=r"must have|Type-check error"):
                model.observe(scans, poses)


def test_evidence_of_a_function_alone_takes_any_poses():
    evidence = ScanEvidence(lambda poses: poses[..., 0], NOWHERE)
    assert evidence.log_likelihood(torch.ones(2, 4, 3).double()).tolist() == [[1.0] * 4] * 2


def test_a_reach_that_single_precision_rounds_down_is_still_no_return():
    scanner = replace(ONE_BEAM, max_range_m=12.7)
    stored = torch.tensor([[12.7]], dtype=torch.float32).double()
    assert float(stored) < 12.7
    assert np.isinf(chosen_ranges(stored, scanner, np.array([0]))).all()


@pytest.mark.parametrize(("beams", "turn"), [(180, np.pi), (181, np.pi), (360, 2 * np.pi), (100, 2 * np.pi)])
def test_chosen_beams_look_evenly(beams, turn):
    scanner = LaserScanner(beams=beams, field_of_view_rad=turn)
    chosen = chosen_beams(scanner, 60)
    assert len(set(chosen.tolist())) == 60
    gaps = np.diff(scanner.angles[chosen])
    assert gaps.max() <= gaps.min() + 1.01 * (scanner.angles[1] - scanner.angles[0])
    if turn < 6:
        assert chosen[[0, -1]].tolist() == [0, beams - 1]
    else:
        closing = 2 * np.pi - (scanner.angles[chosen[-1]] - scanner.angles[chosen[0]])
        assert gaps.min() - 1e-9 <= closing <= gaps.max() + 1e-9 + (scanner.angles[1] - scanner.angles[0])
    assert chosen_beams(scanner, 1000).tolist() == list(range(beams))
    if turn < 6:
        assert abs(scanner.angles[chosen_beams(scanner, 1)[0]]) < 0.02
