"""What README says of the claims is what the board says."""

import re

from docs_commands import ROOT

#: what README calls them, in its order
CLAIMS = {
    "apparent distortion carries over to other lenses": "calibration_apparent_distortion",
    "the bearing loss": "calibration_bearing_loss",
    "the parameterization": "calibration_parameterization",
    "fewer failures than lines where these are few": "calibration_few_lines",
    "all four parameters": "calibration_four_parameters",
    "trained beats hand-made": "places_trained",
    "the ratio loss": "places_ratio_loss",
    "mining": "places_mining",
    "compact and quick": "places_compact_quick",
    "re-ranking finds more places": "places_reranking",
    "correspondences localize finer": "localization_correspondences",
    "any pose": "localization_any_pose",
    "fewer particles than a laser": "localization_fewer_particles",
    "better starts": "localization_start",
    "the approximation": "localization_approximation",
    "weighed restarts beat simple ones at a wrong start": "localization_bad_start",
    "weighed restarts beat simple ones in recovery": "localization_deprivation",
    "learnt features find more robots": "localization_descriptors",
    "both needed in a city": "localization_both_needed",
    "better than NetVLAD by one reference image": "cosfire_netvlad_one",
    "beats network and SVM": "cosfire_network_svm",
    "as good as NetVLAD by many": "cosfire_netvlad_many",
    "beats filters without a network": "cosfire_without_network",
    "99.49 % on MNIST": "cosfire_mnist_9949",
    "no further parameters": "push_pull_parameters",
    "clean accuracy kept": "push_pull_clean",
    "negligible cost": "push_pull_cost",
    "robustness": "push_pull_robustness",
}


def test_every_claim_stands_under_its_verdict():
    text = (ROOT / "results" / "claims.md").read_text()
    board = dict(re.findall(r'^## <a name="(\w+)"></a>`\w+`: ([\w ]+)', text, re.M))
    table = (ROOT / "README.md").read_text().partition("| chapter | holds |")[2].partition("\n\n")[0]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()[2:]]
    planned = {
        name for name, status in re.findall(r"^\| \[(\w+)\].*?\*\* \| (\w+) \|", text, re.M) if status == "planned"
    }
    assert planned
    assert planned == {CLAIMS[claim] for claim in re.findall(r"(?:\| |; )([^|;]*) \(not run\)", table)}
    told = {
        CLAIMS[claim.removesuffix(" (not run)")]: verdict
        for row in rows
        for verdict, cell in zip(("holds", "fails", "undecided", "not learnt"), row[1:], strict=True)
        for claim in filter(None, cell.split("; "))
    }
    assert told == board
