"""What the figures were measured on."""

from sextant.runs.provenance import provenance


def describe_machine() -> str:
    found = provenance()
    hardware, versions = found["hardware"], found["versions"]
    return (
        f"{hardware['processor']}, {hardware['cores']} cores, {hardware['memory_gib']} GiB; "
        f"python {versions['python']}, torch {versions['torch']}, pytorch-lightning {versions['pytorch-lightning']}"
    )
