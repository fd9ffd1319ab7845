"""Which changes of an OpenAPI document break programs that were written for the one before.

What is asked may be widened and what is answered may be added to; the other way round breaks. A
new value of an answered enum is an addition: clients are told to expect it.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

Schema = dict[str, Any]
SMALLEST = ("minimum", "exclusiveMinimum", "minLength", "minItems", "minProperties")
LARGEST = ("maximum", "exclusiveMaximum", "maxLength", "maxItems", "maxProperties")
METHODS = ("get", "put", "post", "delete", "patch", "options")


class Documents(NamedTuple):
    """The document before and the one after."""

    old: Schema
    new: Schema


def breaking(old: Schema, new: Schema) -> list[str]:
    """One line for every change that breaks a client; empty if there is none."""
    documents = Documents(old, new)
    found: list[str] = []
    for path, methods in old["paths"].items():
        for method in METHODS:
            if method not in methods:
                continue
            where = f"{method.upper()} {path}"
            there = new["paths"].get(path, {}).get(method)
            if there is None:
                found.append(f"{where}: the route is gone")
            else:
                found += _of_route(documents, methods[method], there, where)
    return list(dict.fromkeys(found))


def _of_route(documents: Documents, old: Schema, new: Schema, where: str) -> Iterator[str]:
    yield from _of_parameters(documents, old, new, where)
    yield from _of_body(documents, old, new, where)
    for status, answer in old["responses"].items():
        if not status.startswith("2"):
            continue
        if status not in new["responses"]:
            yield f"{where}: it no longer answers {status}"
            continue
        contents = new["responses"][status].get("content", {})
        for kind, content in answer.get("content", {}).items():
            if kind not in contents:
                yield f"{where}: it no longer answers {kind}"
            else:
                schemas = content.get("schema", {}), contents[kind].get("schema", {})
                yield from _Answered(documents).compare(*schemas, f"{where} answers")


def _of_parameters(documents: Documents, old: Schema, new: Schema, where: str) -> Iterator[str]:
    before = {(one["in"], one["name"]): one for one in old.get("parameters", [])}
    after = {(one["in"], one["name"]): one for one in new.get("parameters", [])}
    for (place, name), one in before.items():
        if (place, name) not in after:
            yield f"{where}: the {place} parameter {name} is gone"
        else:
            schemas = one.get("schema", {}), after[place, name].get("schema", {})
            yield from _Asked(documents).compare(*schemas, f"{where}: {name}")
    for (place, name), one in after.items():
        if one.get("required") and not before.get((place, name), {}).get("required"):
            yield f"{where}: the {place} parameter {name} is now required"


def _of_body(documents: Documents, old: Schema, new: Schema, where: str) -> Iterator[str]:
    before, after = old.get("requestBody", {}), new.get("requestBody", {})
    if after.get("required") and not before.get("required"):
        yield f"{where}: a body is now required"
    for kind, content in before.get("content", {}).items():
        if kind not in after.get("content", {}):
            yield f"{where}: a body of {kind} is no longer taken"
        else:
            schemas = content.get("schema", {}), after["content"][kind].get("schema", {})
            yield from _Asked(documents).compare(*schemas, f"{where} takes")


class _Compared:
    """Two schemas, looked at from one side."""

    def __init__(self, documents: Documents):
        self.documents = documents
        self._seen: set[tuple[str, str]] = set()

    def compare(self, old: Schema, new: Schema, where: str) -> list[str]:
        """What breaks."""
        names = str(old.get("$ref")), str(new.get("$ref"))
        if "$ref" in old and "$ref" in new:
            if names in self._seen:
                return []  # a schema within itself
            self._seen.add(names)
        found = self._of_alternatives(
            _alternatives(self.documents.old, old), _alternatives(self.documents.new, new), where
        )
        self._seen.discard(names)
        return found

    def _of_alternatives(self, old: list[Schema], new: list[Schema], where: str) -> list[str]:
        found = []
        for before in old:
            if before.get("type") == "null" and not any(one.get("type") == "null" for one in new):
                found += self.null_gone(where)
                continue
            compared = [self._of_one(before, after, where) for after in new]
            found += min(compared, key=len, default=[f"{where}: it is gone"])
        return found + self.of_more(old, new, where)

    def _of_one(self, old: Schema, new: Schema, where: str) -> list[str]:
        if not new or not old:
            return [] if old == new else self.of_anything(old, new, where)
        kinds = old.get("type"), new.get("type")
        if kinds[0] != kinds[1] and not self.fits(*kinds):
            return [f"{where}: {kinds[0]} became {kinds[1]}"] * 5  # further off than any field
        found = self.of_bounds(old, new, where)
        if gone := set(map(str, _values(old))) - set(map(str, _values(new))):
            if _values(new):
                found.append(f"{where}: {', '.join(sorted(gone))} is gone")
        elif not _values(old) and _values(new):
            found += self.of_anything(old, new, where)
        found += self._of_fields(old, new, where)
        for part in ("items", "additionalProperties"):
            if isinstance(old.get(part), dict) and isinstance(new.get(part), dict):
                found += self.compare(old[part], new[part], f"{where} {part}")
        return found

    def _of_fields(self, old: Schema, new: Schema, where: str) -> list[str]:
        found = []
        fields = new.get("properties", {})
        for name, one in old.get("properties", {}).items():
            if name in fields:
                found += self.compare(one, fields[name], f"{where}.{name}")
            elif new.get("additionalProperties") in (None, False):
                found.append(f"{where}.{name}: the field is gone")
        return found + self.of_required(
            set(old.get("required", [])), set(new.get("required", [])), where
        )

    # --- what differs by side ---

    def fits(self, old: str | None, new: str | None) -> bool:
        raise NotImplementedError

    def null_gone(self, where: str) -> list[str]:
        raise NotImplementedError

    def of_more(self, old: list[Schema], new: list[Schema], where: str) -> list[str]:
        raise NotImplementedError

    def of_anything(self, old: Schema, new: Schema, where: str) -> list[str]:
        raise NotImplementedError

    def of_bounds(self, old: Schema, new: Schema, where: str) -> list[str]:
        raise NotImplementedError

    def of_required(self, old: set[str], new: set[str], where: str) -> list[str]:
        raise NotImplementedError


class _Asked(_Compared):
    """What clients send: all that was taken must be taken still."""

    def fits(self, old: str | None, new: str | None) -> bool:
        return (old, new) == ("integer", "number") or new is None

    def null_gone(self, where: str) -> list[str]:
        return [f"{where}: null is no longer taken"]

    def of_more(self, old: list[Schema], new: list[Schema], where: str) -> list[str]:
        return []

    def of_anything(self, old: Schema, new: Schema, where: str) -> list[str]:
        return [f"{where}: no longer anything is taken"] if new else []

    def of_bounds(self, old: Schema, new: Schema, where: str) -> list[str]:
        return [
            f"{where}: {name} was {old.get(name, 'none')} and is {new[name]}"
            for names, tighter in ((SMALLEST, _above), (LARGEST, _below))
            for name in names
            if name in new and tighter(new[name], old.get(name))
        ] + [
            f"{where}: its {name} was {old.get(name, 'none')} and is {new[name]}"
            for name in ("pattern", "format")
            if name in new and new[name] != old.get(name)
        ]

    def of_required(self, old: set[str], new: set[str], where: str) -> list[str]:
        return [f"{where}.{name}: the field is now required" for name in sorted(new - old)]


class _Answered(_Compared):
    """What clients read: all that they knew to be there must be there still."""

    def fits(self, old: str | None, new: str | None) -> bool:
        return (old, new) == ("number", "integer") or old is None

    def null_gone(self, where: str) -> list[str]:
        return []

    def of_more(self, old: list[Schema], new: list[Schema], where: str) -> list[str]:
        nulls = [any(one.get("type") == "null" for one in some) for some in (old, new)]
        return [f"{where}: it may now be null"] if nulls == [False, True] and old != [{}] else []

    def of_anything(self, old: Schema, new: Schema, where: str) -> list[str]:
        return [f"{where}: it may now be anything"] if old and not new else []

    def of_bounds(self, old: Schema, new: Schema, where: str) -> list[str]:
        return []

    def of_required(self, old: set[str], new: set[str], where: str) -> list[str]:
        return [f"{where}.{name}: the field may now be missing" for name in sorted(old - new)]


def _alternatives(document: Schema, schema: Schema) -> list[Schema]:
    """The schemas of which one holds, looked up and taken apart."""
    if "$ref" in schema:
        target: Any = document
        for part in schema["$ref"].removeprefix("#/").split("/"):
            target = target[part]
        return _alternatives(document, target)
    for word in ("anyOf", "oneOf"):
        if word in schema:
            return [one for part in schema[word] for one in _alternatives(document, part)]
    if isinstance(schema.get("type"), list):
        return [{**schema, "type": kind} for kind in schema["type"]]
    return [schema]


def _values(schema: Schema) -> list[Any]:
    return [schema["const"]] if "const" in schema else schema.get("enum", [])


def _above(new: float, old: float | None) -> bool:
    return old is None or new > old


def _below(new: float, old: float | None) -> bool:
    return old is None or new < old
