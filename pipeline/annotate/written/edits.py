"""Changes to the text of a scene file that leave all else in it as it stands.

The marks of the file's YAML nodes tell where each value is written. What changes from one state of the values to the
next becomes a few replacements in the text; comments, blank lines, quotes and the order of everything else are never
written anew.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from difflib import SequenceMatcher
from typing import Any

from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from pipeline.annotate.written.yaml_text import WIDTH, block, entry, flow, item, wants_lines, word

#: Things of which later ones lie over, or stand on, earlier ones: their order is part of what is said.
ORDERED = (("depth", "regions"), ("shapes",))

#: A list in brackets to which more is added, or from which more is taken, is wrapped anew.
MOST_PIECES = 4


def edited(text: str, root: MappingNode, old: dict[str, Any], new: dict[str, Any], sections: list[str],
           whole: tuple | None = None) -> str:
    """The text changed so that it holds `new` instead of `old`; the caller has to read it and see whether it does.

    root: nodes of `text`. sections: names of the file's first level, in the order in which new ones are added.
    whole: keys of a value that is written anew in one piece, comments in it included.
    """
    edits = _Edits(text, sections, whole)
    edits.value((), root, 0, old, new, in_line=root.flow_style)
    return edits.result()


def same(a: Any, b: Any) -> bool:
    """Whether two values are equal, True and 1 being different, and the order of names not counting."""
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(map(same, a, b))
    return type(a) in (int, float) and type(b) in (int, float) and a == b or type(a) is type(b) and a == b


def unchanged(a: Any, b: Any, where: tuple = ()) -> bool:
    """Whether two values at `where` are the same, the order of things counting that lie over one another."""
    below = [keys[len(where):] for keys in ORDERED if keys[:len(where)] == where]
    return same(a, b) and all(list(_at(a, keys)) == list(_at(b, keys)) for keys in below)


def _items(value: Any) -> list:
    return list(value.values()) if isinstance(value, dict) else []


def _at(values: Any, where: tuple) -> dict:
    for key in where:
        values = values.get(key) if isinstance(values, dict) else None
    return values if isinstance(values, dict) else {}


@dataclass
class _Edits:
    text: str
    sections: list[str]
    whole: tuple | None
    parts: list[tuple[int, int, str]] = field(default_factory=list)

    def result(self) -> str:
        text = self.text
        # of several at one place those noted later stand later; a removal from there on comes before them
        for _, (start, end, new) in sorted(enumerate(self.parts), key=lambda p: (p[1][0], p[1][1], p[0]), reverse=True):
            text = text[:start] + new + text[end:]
        return text

    # ---- what stands where
    def column(self, index: int) -> int:
        return index - self.text.rfind("\n", 0, index) - 1

    def next_line(self, index: int) -> int:
        """Where the line after that of `index` begins."""
        end = self.text.find("\n", index)
        return len(self.text) if end < 0 else end + 1

    def blank_before(self, index: int) -> bool:
        return not self.text[self.text.rfind("\n", 0, index) + 1:index].strip()

    def end(self, node: Node, after: int) -> int:
        """Where the node's own text ends, without comments behind it; `after` its key's colon or its dash."""
        if isinstance(node, ScalarNode) or node.flow_style or not node.value:
            if node.start_mark.index >= node.end_mark.index:
                return after
            return node.start_mark.index + len(self.text[node.start_mark.index:node.end_mark.index].rstrip())
        last = node.value[-1]
        return self.end(last[1], self.colon(last[0])) if isinstance(last, tuple) else self.end(last, self.dash(last) + 1)

    def colon(self, key: Node) -> int:
        """Index behind the colon of a key."""
        return self.text.index(":", key.end_mark.index) + 1

    def dash(self, node: Node) -> int:
        return self.text.rindex("-", 0, node.start_mark.index)

    def first(self, node: Node) -> int:
        """Where a group or list on lines of its own begins, behind an anchor."""
        first = node.value[0]
        return first[0].start_mark.index if isinstance(first, tuple) else self.dash(first)

    # ---- changes
    def value(self, where: tuple, node: Node, after: int, old: Any, new: Any, in_line: bool) -> None:
        """From `old` to `new` at `node`, which is in braces or brackets if `in_line`."""
        ordered = where in ORDERED and isinstance(old, dict) and isinstance(new, dict)
        if where != self.whole and unchanged(old, new, where):
            return
        if where != self.whole and isinstance(node, MappingNode) and isinstance(new, dict) and set(old) & set(new):
            self.group(where, node, old, new, ordered)
        elif where != self.whole and isinstance(node, SequenceNode) and isinstance(new, list) and old and new:
            self.list(where, node, old, new)
        else:
            self.replaced(node, after, new, in_line)

    def replaced(self, node: Node, after: int, new: Any, in_line: bool) -> None:
        start, end = node.start_mark.index, self.end(node, after)
        on_lines = not (isinstance(node, ScalarNode) or node.flow_style or not node.value)
        if on_lines:
            start = self.first(node)
        nothing = start >= end
        if nothing:
            start = end = after
        if not in_line and wants_lines(new):
            if on_lines:
                self.parts.append((start, self.next_line(end), block(new, self.column(start)).lstrip(" ")))
                return
            line = self.text.rfind("\n", 0, after) + 1
            indent = len(self.text[line:]) - len(self.text[line:].lstrip(" -"))
            rest = self.text[end:self.next_line(end)]
            self.parts.append((start if rest.strip() else after, end, ""))
            self.lines(self.next_line(end), block(new, indent + 2))
            return
        if on_lines and not self.text[after:start].strip() and after:
            start, nothing = after, True
        space = " " * nothing
        self.parts.append((start, end, space + flow(new, self.column(start) + len(space))))

    def lines(self, index: int, new: str) -> None:
        """Whole lines, at the beginning of a line or behind the last."""
        broken = index and self.text[index - 1] != "\n"
        self.parts.append((index, index, "\n" * bool(broken) + new))

    def group(self, where: tuple, node: MappingNode, old: dict, new: dict, ordered: bool) -> None:
        pairs = {key.value: (key, value) for key, value in node.value}
        names = list(new) if ordered else [n for n in old if n in new] + [n for n in new if n not in old]
        kept, added = set(), []  # added: the name after which each new one stands, and the new one
        before = None
        for kind, a, b, c, d in SequenceMatcher(None, list(old), names, autojunk=False).get_opcodes():
            if kind == "equal":
                kept.update(names[c:d])
                before = names[d - 1]
            else:
                added += [(before, name) for name in names[c:d]]
        for name in kept:
            key, value = pairs[name]
            self.value((*where, name), value, self.colon(key) if not node.flow_style else value.start_mark.index,
                       old[name], new[name], node.flow_style)
        gone = [n for n, name in enumerate(old) if name not in kept]
        if node.flow_style:
            self.left_out([(key.start_mark.index, value.end_mark.index) for key, value in node.value], gone)
            places = {name: value.end_mark.index for name, (_, value) in pairs.items()}
            self.put_in(node, [(None if b is None else places[b], word(n) + ": ", new[n]) for b, n in added])
            return
        for n in gone:
            key, value = node.value[n]
            self.line_out(key.start_mark.index, self.end(value, self.colon(key)))
        indent = self.column(node.value[0][0].start_mark.index)
        for b, name in added:
            if not where:
                b = self.section_before(name, [n for n in old if n in kept])
            after = pairs[b] if b else None
            index = self.first(node) if after is None else self.next_line(self.end(after[1], self.colon(after[0])))
            alike = next((v for n, (_, v) in reversed(pairs.items()) if isinstance(v, MappingNode)), None)
            moved = name in old and same(old[name], new[name]) and self.blank_before(pairs[name][0].start_mark.index)
            if moved:  # with its own comments
                key, value = pairs[name]
                start = self.text.rfind("\n", 0, key.start_mark.index) + 1
                written = self.text[start:self.next_line(self.end(value, self.colon(key)))]
                written += "\n" * (not written.endswith("\n"))
            else:
                braces = alike is not None and alike.flow_style and not any(
                    isinstance(one, dict) or isinstance(one, list) and not where for one in _items(new[name]))
                written = entry(name, new[name], indent, in_braces=bool(braces))
            if after is None:
                index = index - self.column(index) if self.blank_before(index) else index
            if not where:
                index = self.behind_comments(index) if after is not None else index
                following = self.text[index:self.next_line(index)].strip()
                written = "\n" * bool(b) + written + "\n" * bool(following)
            self.lines(index, written)

    def behind_comments(self, index: int) -> int:
        """Index of the line behind those comments below a section that are indented as what is in it."""
        end = index
        while index < len(self.text):
            line = self.text[index:self.next_line(index)]
            index = self.next_line(index)
            if line.strip() and not (line.startswith(" ") and line.lstrip().startswith("#")):
                break
            if line.strip():
                end = index
        return end

    def section_before(self, name: str, present: list[str]) -> str | None:
        """Which of the sections that are there a new one follows."""
        rank = {section: n for n, section in enumerate(self.sections)}
        earlier = [n for n in present if rank.get(n, len(rank)) < rank.get(name, len(rank))]
        return max(earlier, key=present.index) if earlier else (present[-1] if name not in rank else None)

    def list(self, where: tuple, node: SequenceNode, old: list, new: list) -> None:
        first = next((n for n, (a, b) in enumerate(zip(old, new)) if not same(a, b)), min(len(old), len(new)))
        most = min(len(old), len(new)) - first
        last = next((n for n in range(most) if not same(old[-1 - n], new[-1 - n])), most) if len(old) != len(new) else 0
        middle_old, middle_new = len(old) - last - first, len(new) - last - first
        both, noted = min(middle_old, middle_new), len(self.parts)
        for n in range(first, first + both):
            self.value((*where, n), node.value[n], node.value[n].start_mark.index if node.flow_style else self.dash(node.value[n]) + 1,
                       old[n], new[n], node.flow_style)
        if node.flow_style and abs(len(old) - len(new)) > MOST_PIECES and "#" not in self.text[
                node.start_mark.index:node.end_mark.index]:
            self.parts = self.parts[:noted]
            self.replaced(node, node.start_mark.index, new, True)
            return
        gone = list(range(first + both, first + middle_old))
        added = new[first + both:first + middle_new]
        before = first + both - 1
        if node.flow_style:
            self.left_out([(n.start_mark.index, n.end_mark.index) for n in node.value], gone)
            place = node.value[before].end_mark.index if before >= 0 else None
            self.put_in(node, [(place, "", one) for one in added])
            return
        for n in gone:
            self.line_out(self.dash(node.value[n]), self.end(node.value[n], self.dash(node.value[n]) + 1))
        indent = self.column(self.dash(node.value[0]))
        for one in added:
            after = node.value[before] if before >= 0 else None
            index = (self.dash(node.value[0]) - indent if after is None
                     else self.next_line(self.end(after, self.dash(after) + 1)))
            self.lines(index, item(one, indent))

    # ---- entries on lines of their own
    def line_out(self, start: int, end: int) -> None:
        """Removes an entry with the comment behind it."""
        if self.blank_before(start):
            self.parts.append((start - self.column(start), self.next_line(end), ""))
            return
        # the first of a group that begins behind a dash: the next one moves up
        following = self.next_line(end)
        text = self.text[following:self.next_line(following)]
        moves = text.strip() and not text.lstrip().startswith("#")
        self.parts.append((start, following + len(text) - len(text.lstrip()) if moves else following, "" if moves else "\n"))

    # ---- entries in braces or brackets
    def left_out(self, spans: list[tuple[int, int]], gone: list[int]) -> None:
        """Removes entries with a comma each; comments between them stay."""
        if not gone:
            return
        leading = next((n for n in range(len(spans)) if n not in gone), len(spans))
        for n in gone:
            start, end = spans[n]
            gap = (end, spans[n + 1][0]) if n < leading else (spans[n - 1][1], start)
            between = self.text[gap[0]:gap[1]]
            if "#" not in between:
                self.parts.append((min(start, gap[0]), max(end, gap[1]), ""))
                continue
            comma = gap[0] + _comma(between)
            self.parts += [(start, end, ""), (comma, comma + 1, "")]

    def put_in(self, node: Node, added: list[tuple[int | None, str, Any]]) -> None:
        """Adds (index of the end of the entry before, or None; key with its colon; value)."""
        opening = self.text.index("{" if isinstance(node, MappingNode) else "[", node.start_mark.index)
        below = self.column(opening) + 1
        at: dict[int | None, int] = {}
        for place, key, value in added:
            index = opening + 1 if place is None else place
            column = at.get(place, self.column(index))
            written = key + flow(value, column + 2 + len(key))
            fits = "\n" not in written and column + 2 + len(written) + 1 <= WIDTH
            if not fits:
                written = key + flow(value, below + len(key))
            if place is None:
                written += ", "
            else:
                written = (", " if fits else ",\n" + " " * below) + written
            at[place] = column + len(written) if "\n" not in written else len(written) - written.rfind("\n") - 1
            self.parts.append((index, index, written))


def _comma(between: str) -> int:
    """Index of the comma that is in no comment."""
    start = 0
    for line in between.splitlines(keepends=True):
        found = line.partition("#")[0].find(",")
        if found >= 0:
            return start + found
        start += len(line)
    return 0
