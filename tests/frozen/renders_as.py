"""Compare what two versions render: ``python tests/frozen/renders_as.py <commit>``, a minute or two.

Rendered datasets are found by a hash of the source that renders. A change of that source that leaves every byte as it
was, such as an error for a wrong argument, is entered in ``SAME_BYTES`` of ``sextant.data.rendered.splits``, so that
what users have rendered, and their runs on it, are found again. The commit is one before the change; the working tree
is compared with it on small datasets of every kind, and the entry is printed if they are the same.
"""

import hashlib
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import yaml

HERE = Path(__file__).parents[2]
TOWN = {"frames": {"train": 4, "val": 2, "test": 4}}
#: the kinds of rendered datasets, with few images
SMALL: dict[str, dict[str, Any]] = {
    "office_walk": {"metres": [4.0, 3.0, 3.0], "every": 6},
    "town_seasons": TOWN,
    "town_factors": TOWN | {"places": {"train": 2, "test": 2}},
    "town_city": {"images": 64, "size_m": 600.0, "query_frames": 8},
    "town_panoramas": {"images": {"train": 5, "val": 2, "test": 2}, "towns": {"train": 2, "val": 1, "test": 1},
                       "height": 96},
}  # fmt: skip


def rendered() -> dict[str, Any]:
    """The hash of the source of the version that is imported, and of each array and column that it renders."""
    from sextant.data import worlds
    from sextant.data.rendered import splits

    splits.SAME_BYTES = ("", "")
    found: dict[str, Any] = {}
    for name, small in SMALL.items():
        config = yaml.safe_load((HERE / f"conf/dataset/{name}.yaml").read_text()) | small
        kind = getattr(worlds, config.pop("_target_").rsplit(".", 1)[-1])
        plan = kind(roots=[Path("/nowhere")], **config).plan()
        found["source"] = plan.source_sha256
        parts = {f"{name}.{key}": value for key, value in plan.columns.items()}
        parts |= {f"{name}.{key}": value for key, value in plan.render(0, plan.count).items()}
        found |= {key: hashlib.sha256(value.tobytes()).hexdigest() for key, value in parts.items()}
        print(f"{name}: {plan.count} items", file=sys.stderr)
    return found


def rendered_by(source: Path) -> dict[str, Any]:
    """What the version in a folder renders, by another process."""
    done = subprocess.run(
        [sys.executable, __file__, "--render"], env=os.environ | {"PYTHONPATH": str(source)}, check=True,
        stdout=subprocess.PIPE, cwd="/",
    )  # fmt: skip
    return json.loads(done.stdout)


def main(commit: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        archive = subprocess.run(["git", "archive", commit, "src"], cwd=HERE, check=True, stdout=subprocess.PIPE)
        subprocess.run(["tar", "-x", "-C", folder], input=archive.stdout, check=True)
        before = rendered_by(Path(folder) / "src")
    now = rendered_by(HERE / "src")
    old, new = before.pop("source"), now.pop("source")
    if differing := sorted(key for key in before.keys() | now.keys() if before.get(key) != now.get(key)):
        raise SystemExit(f"These differ, of {len(before)}: {', '.join(differing)}")
    print(f"All {len(now)} arrays are the same: SAME_BYTES may begin with {new!r}; that of {commit} is {old!r}")


if __name__ == "__main__":
    if sys.argv[1:] == ["--render"]:
        print(json.dumps(rendered()))
    else:
        main(*sys.argv[1:])
