"""Names of folders with characters that mean something to an address, a shell, Hydra's grammar or a glob pattern.

The boundaries: escapes of addresses (also escaped twice, cut off or alone), their separators, quotes and backslashes,
patterns, expansions of a shell, beginnings and ends that are stripped elsewhere, letters in both Unicode forms, control
characters, words that Hydra reads as another type, and the longest name that Linux allows.
"""

ODD_NAMES = (
    *("feature%2Flidar", "a%20b", "%", "100%", "a%%b", "%252F", "a%3Fb"),
    *("q?x", "c#1", "a&b", "a=b", "a;b", "a+b", "a:b", "a@b", "file:", "sqlite:", "a,b"),
    *("a b", "it's", 'a"b', "a\\b", "a\\", "'q", "[x]", "{a}", "(a)", "*", "$HOME", "~", "-x", "!x", "`x`"),
    *("end ", " lead", "end.", "cafe\u0301", "caf\u00e9", "\U0001f600", "new\nline", "100", "true", "x" * 255),
)
#: a name that is not UTF-8, as old archives leave it, which no database address can hold
NOT_UTF8 = "a\udcffb"
