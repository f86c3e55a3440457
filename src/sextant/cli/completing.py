"""Completion in the shell: ``eval "$(sextant -sc install=bash)"``, then the verbs, keys and values by the tab key.

The flag and the variable ``COMP_LINE`` are those of Hydra's own completion, which a shell may already have installed
for ``python``: every script that it then calls prints completions or nothing, never an error.
"""

import os
import re
from collections.abc import Mapping, Sequence
from contextlib import redirect_stderr, suppress
from importlib import import_module
from typing import Any

FLAGS = ("-sc", "--shell-completion")
#: verbs whose arguments are overrides of a config
OVERRIDES = ("train", "evaluate")
ASKS = "COMP_LINE={line} sextant -sc query={shell} 2>/dev/null"
BASH = f"""\
_sextant() {{ local IFS=$'\\n'; COMPREPLY=($({ASKS.format(line='"${COMP_LINE:0:COMP_POINT}"', shell="bash")})); }}
COMP_WORDBREAKS=${{COMP_WORDBREAKS//=}}
complete -o nospace -o default -F _sextant sextant"""
#: shell code that requests completions
SCRIPTS = {
    "bash": BASH,
    "zsh": f"autoload -U +X bashcompinit && bashcompinit\n{BASH}",
    "fish": f"complete -c sextant -f -a '({ASKS.format(line='(commandline -cp)', shell='fish')})'",
}


def completes(verb: str, arguments: Sequence[str]) -> bool:
    """Whether a call requests completion; Hydra installs its own for ``python train.py``."""
    asks = any(word in FLAGS for word in (verb, *arguments))
    return asks and not (verb == "train" and any("install=" in word for word in arguments))


def complete(verb: str, arguments: Sequence[str], verbs: Mapping[str, tuple[str, str]]) -> None:
    """Print the script that installs completion, or the completions at the cursor.

    Args:
        verb: the script that was called; a flag or nothing for ``sextant`` itself.
        arguments: ``install=<shell>`` or ``query=<shell>``.
        verbs: module and meaning of each verb.
    """
    install = next((word.partition("=")[2] for word in arguments if word.startswith("install=")), None)
    if install is not None:
        print(SCRIPTS.get(install, f"echo 'sextant supports completion in {', '.join(SCRIPTS)}, not in {install}'"))
        return
    with open(os.devnull, "w") as nowhere, redirect_stderr(nowhere), suppress(Exception, SystemExit):
        print("\n".join(candidates(os.environ.get("COMP_LINE", ""), verb if verb in verbs else None, verbs)))


def candidates(line: str, verb: str | None, verbs: Mapping[str, tuple[str, str]]) -> list[str]:
    """The possible completions of the last word of a command line.

    Args:
        line: the line up to the cursor: ``sextant <verb> ..`` or ``python <verb>.py ..``.
        verb: the verb of a script; None for ``sextant``, whose first argument is the verb.
        verbs: module and meaning of each verb.
    """
    words = line.split()
    word = words.pop() if words and not line[-1].isspace() else ""
    rest = words[2 if words and re.search(r"python[\d.]*$", words[0]) else 1 :]
    if verb is None:
        if not rest:
            return [each for each in (*verbs, "--help", "--version") if each.startswith(word)]
        verb = rest.pop(0)
    if verb in OVERRIDES:
        found = ["run="] if verb == "evaluate" else []
        found += _overrides(" ".join([*rest, word]))
    else:
        found = _keys(import_module(verbs[verb][0]))
    given = {each.partition("=")[0] for each in rest}
    return [each for each in found if each.startswith(word) and each != word and each.partition("=")[0] not in given]


def _keys(module: Any) -> list[str]:
    """The keys that a verb takes, each ending in ``=``, and those of their values that are words."""
    from sextant.console.arguments import Options, word_values

    own = [each for each in vars(module).values() if isinstance(each, type) and issubclass(each, Options)]
    fields = {key: field for each in own for key, field in each.fields().items()}
    keys = dict.fromkeys([*fields, *getattr(module, "KEYS", {})])
    return [f"{key}={value}" for key in keys for value in ("", *(word_values(fields[key]) if key in fields else ()))]


def _overrides(line: str) -> list[str]:
    """Groups, keys and options as Hydra completes them."""
    from hydra._internal.config_loader_impl import ConfigLoaderImpl
    from hydra._internal.core_plugins.bash_completion import BashCompletion
    from hydra._internal.utils import create_config_search_path
    from hydra.core.plugins import Plugins

    from sextant.composing.compose import register_resolvers
    from sextant.runs.outputs_folder import conf_dir

    Plugins.instance()
    register_resolvers()
    loader = ConfigLoaderImpl(create_config_search_path(str(conf_dir())))
    return list(BashCompletion(loader)._query("train", line))
