"""The claims of ``conf/claim``."""

from collections.abc import Mapping
from pathlib import Path

from pydantic import ValidationError

from sextant.composing.config_files import read_config_file
from sextant.config import nearest
from sextant.config.schema.claims import Claim
from sextant.errors import UserError
from sextant.runs.outputs_folder import conf_dir

Claims = Mapping[str, Claim]


def read_claims(which: str = "all") -> Claims:
    """Read the claims of ``conf/claim`` by name, in order of chapter.

    Raises:
        UserError: there is no claim of that name, or a file is invalid.
    """
    found = {path.stem: _read_claim(path) for path in sorted((conf_dir() / "claim").glob("*.yaml"))}
    if which == "all":
        return dict(sorted(found.items(), key=lambda entry: entry[1].chapter))
    if which not in found:
        near = nearest(which, found)
        raise UserError(f"claim={which}: no such claim", f"Did you mean {near}?" if near else ", ".join(found))
    return {which: found[which]}


def _read_claim(path: Path) -> Claim:
    try:
        return Claim.model_validate(read_config_file(path))
    except ValidationError as error:
        told = "; ".join(f"{'.'.join(map(str, e['loc']))}: {e['msg']}" for e in error.errors())
        raise UserError(f"{path}: {told}", "The keys of a claim are in config/schema/claims.py.") from None
