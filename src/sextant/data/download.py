"""Downloads, through torchvision."""

from pathlib import Path

from sextant.errors import UserError


def torchvision_download(name: str, root: Path, train: bool) -> None:
    """Fetch ``torchvision.datasets.<name>`` into ``root`` in torchvision's layout.

    Raises:
        UserError: the download failed; the message says why, and which dataset needs none.
    """
    from torchvision import datasets

    try:
        getattr(datasets, name)(str(root), train=train, download=True)
    except Exception as error:  # torchvision raises errors of any kind
        raise UserError(
            f"could not download {name} into {root}: {error}",
            "Fetch it by hand and set SEXTANT_DATA, or use dataset=digits, which needs no download.",
        ) from None
