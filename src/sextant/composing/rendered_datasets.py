"""Which options of the group ``dataset`` are rendered on this machine."""

from hydra.utils import get_object

from sextant.composing.config_files import groups, read_config_file
from sextant.runs.outputs_folder import conf_dir


def is_rendered(target: str) -> bool:
    """Whether an import path names a rendered dataset; true for a user's own path that cannot be imported."""
    try:
        return callable(getattr(get_object(target), "plan", None))
    except Exception:  # importing the user's module may raise anything; building it reports more
        return not target.startswith("sextant.")


def rendered_datasets() -> str:
    """A sentence that lists the options that can be rendered."""
    names = []
    for name in groups()["dataset"]:
        target = read_config_file(conf_dir() / "dataset" / f"{name}.yaml").get("_target_")
        if target and is_rendered(str(target)):
            names.append(name)
    return f"Rendered datasets: {', '.join(names) or 'none yet'}"
