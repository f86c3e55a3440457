"""Which options of the group ``dataset`` are rendered on this machine."""

from hydra.utils import get_object

from sextant.composing.config_files import groups, read_config_file
from sextant.runs.outputs_folder import conf_dir


def is_rendered(target: str) -> bool:
    """Whether what an import path names is rendered; one that cannot be imported is, if it is the user's own."""
    try:
        return callable(getattr(get_object(target), "plan", None))
    except Exception:  # get_object raises whatever importing the user's module does; building it tells more
        return not target.startswith("sextant.")


def rendered_datasets() -> str:
    """The options that can be rendered, in one sentence."""
    names = []
    for name in groups()["dataset"]:
        target = read_config_file(conf_dir() / "dataset" / f"{name}.yaml").get("_target_")
        if target and is_rendered(str(target)):
            names.append(name)
    return f"Rendered datasets: {', '.join(names) or 'none yet'}"
