"""Mutations of a scene file's text, as a careless editor or a stranger might leave it."""

from __future__ import annotations

import re
from random import Random

from tests.fuzzing.bases import bases

#: What values are replaced by. OWNED would be a file, if any of them were executed.
EXTREMES = [
    "0", "-0.0", "-1", "1", "1e308", "-1e308", "1e-320", "1e39", "1e12", "1e7", "-1e7", ".nan", ".inf", "-.inf", "9" * 400,
    "99999999999999999999", "4294967296", "0o777", "0x7fffffff", "0b1", "1_000", "60:30", "2024-02-30", "2024-01-01",
    "2001-12-14t21:59:43.10-05:00", "null", "~", "", "''", "[]", "{}", "[[]]", "[1]", "[1, 2]", "[1, 2, 3]", "[1, 2, 3, 4]",
    "[0, 0, 0]", "[.nan, .inf, 0]", "[1e7, 1e7, 1e7]", "[[0, 0], [0, 0], [0, 0]]", "[[0, 0], [1, 1], [2, 2], [0, 0]]",
    "true", "no", "yes", "'true'", "'3'", "3 m", "x" * 300, "x" * 100_000, "\u202e\u0000x", "'\\e[31m'", "\"\\e[2J\\a\"",
    "\"\\u0000\"", "\"a\\nb\"", "\u00e4\u00f6\u00fc\U0001f32b", "../../etc/passwd", "/etc/passwd", "../outside/secret.png", "link.png", "folder",
    "pipe", "photograph.png/../../x", "file:///etc/passwd", "http://example.org/x.png", "\"scene.yaml\"", "density.npy",
    "depth.png", "missing.png", ".", "..", "/dev/zero", "/dev/stdin", "\"<% include '/etc/passwd' %>\"",
    "\"<< ''.__class__.__mro__ >>\"", "\"{{ 7*7 }}\"", "\"${HOME}\"", "\"$(touch OWNED)\"", "\"`touch OWNED`\"", "\"%n%s%s\"",
    "!!python/object/apply:os.system ['touch OWNED']", "!!python/name:os.system", "!!binary aGk=", "!!set {a, b}", "!!omap []",
    "!!float 3", "!!int '7'", "!!str 7", "!local 3", "&a [*a]", "*nobody", "&a {<<: *a}", "[" * 40 + "]" * 40,
    "[" * 3000 + "]" * 3000, "{a: " * 60 + "1" + "}" * 60, "|\n  text", ">-\n  folded", "? a", "- b", "@reserved", "%TAG", "\t1",
]
BOMB = ("a: &a [x, x, x, x, x, x, x, x, x]\n"
        + "".join(f"{q}: &{q} [{', '.join([f'*{p}'] * 9)}]\n" for p, q in zip("abcdefgh", "bcdefghi")))


def _lines(text: str) -> list[str]:
    return text.split("\n")


def flip_byte(rng: Random, text: str) -> str:
    at = rng.randrange(max(len(text), 1))
    return text[:at] + chr(rng.choice([rng.randrange(1, 128), rng.randrange(128, 0xD7FF), 0])) + text[at + 1:]


def delete_line(rng: Random, text: str) -> str:
    lines = _lines(text)
    del lines[rng.randrange(len(lines))]
    return "\n".join(lines)


def repeat_line(rng: Random, text: str) -> str:
    lines = _lines(text)
    at = rng.randrange(len(lines))
    lines.insert(rng.choice([at, rng.randrange(len(lines))]), lines[at])
    return "\n".join(lines)


def swap_lines(rng: Random, text: str) -> str:
    lines = _lines(text)
    a, b = rng.randrange(len(lines)), rng.randrange(len(lines))
    lines[a], lines[b] = lines[b], lines[a]
    return "\n".join(lines)


def indent_line(rng: Random, text: str) -> str:
    lines = _lines(text)
    at = rng.randrange(len(lines))
    lines[at] = rng.choice([" ", "  ", "\t", "- "]) + lines[at] if rng.random() < 0.6 else lines[at][2:]
    return "\n".join(lines)


def cut(rng: Random, text: str) -> str:
    return text[:rng.randrange(len(text) + 1)]


def other_value(rng: Random, text: str) -> str:
    """One value after `key:` replaced, block or flow."""
    found = list(re.finditer(r"(?<=: )[^,{}\[\]\n]+", text))
    if not found:
        return text
    match = rng.choice(found)
    return text[:match.start()] + rng.choice(EXTREMES) + text[match.end():]


def other_number(rng: Random, text: str) -> str:
    found = list(re.finditer(r"-?\d+(\.\d+)?", text))
    if not found:
        return text
    match = rng.choice(found)
    number = float(match.group())
    near = [repr(number * rng.choice([-1, 0.1, 10, 1e3, 1e-3])), repr(number + rng.choice([-1, 1, 50, -50])),
            str(rng.randrange(-100, 1000)), match.group() * 2]
    return text[:match.start()] + rng.choice([*near, *EXTREMES[:20]]) + text[match.end():]


def other_key(rng: Random, text: str) -> str:
    found = list(re.finditer(r"[A-Za-z_][\w]*(?=:)", text))
    if len(found) < 2:
        return text
    match, other = rng.sample(found, 2)
    word = rng.choice([match.group()[:-1], match.group().upper(), other.group(), "<<", "? [1]", "x" * 60, "a b", "__class__",
                       "'<< 7*7 >>'", "'{{ 7 }}'", "'../x'", "\u00fc", "1", "null", "true", "model_fields", "\"\\e[31m\""])
    return text[:match.start()] + word + text[match.end():]


def other_word(rng: Random, text: str) -> str:
    """A word of the file, a type or a name, in the place of another."""
    found = list(re.finditer(r"(?<=: )[A-Za-z_.]+", text))
    words = [m.group() for base in bases() for m in re.finditer(r"(?<=: )[A-Za-z_.]+", base.text)]
    if not found:
        return text
    match = rng.choice(found)
    return text[:match.start()] + rng.choice(words) + text[match.end():]


def anchors(rng: Random, text: str) -> str:
    return rng.choice([BOMB + text, text + "\n" + BOMB, text.replace(": ", ": &a ", 1) + "\nx: *a\n",
                       text.replace(": ", ": &a ", 3)])


def documents(rng: Random, text: str) -> str:
    return rng.choice(["---\n" + text, text + "\n---\n" + text, text + "\n...\n", "%YAML 1.1\n---\n" + text,
                       "%TAG ! tag:x,2000:\n---\n" + text, "\ufeff" + text, text.replace("\n", "\r\n"), text.replace("\n", "\r"),
                       "#" * 2_100_000 + "\n" + text, text + "\n" * 100_000])


def bytes_of(rng: Random, text: str) -> bytes:
    """The text in another encoding, or with bytes that are none."""
    data = bytearray(text.encode("utf-8", "surrogatepass"))
    way = rng.randrange(4)
    if way == 0:
        return text.encode(rng.choice(["utf-16", "utf-32", "utf-8-sig"]), "replace")
    for _ in range(rng.randrange(1, 6)):
        if data:
            data[rng.randrange(len(data))] = rng.randrange(256)
    return bytes(data)


MUTATORS = {f.__name__: f for f in (flip_byte, delete_line, repeat_line, swap_lines, indent_line, cut, other_value, other_number,
                                    other_key, other_word, anchors, documents)}
#: How often each is taken: most cases should get past the parser.
WEIGHTS = [2, 2, 2, 1, 1, 1, 8, 8, 3, 4, 1, 1]
