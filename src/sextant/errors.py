"""The one exception that stands for a user's mistake."""


class UserError(Exception):
    """A mistake that the user can mend; commands print it as one message, never as a traceback.

    Args:
        problem: what is wrong, naming the key or file, the value, and what is allowed.
        fix: what to do about it, if possible something to paste.
    """

    def __init__(self, problem: str, fix: str | None = None):
        self.problem = problem
        self.fix = fix
        super().__init__(problem if fix is None else f"{problem}\n{fix}")

    def __reduce__(self) -> tuple[type["UserError"], tuple[str, str | None]]:
        return type(self), (self.problem, self.fix)
