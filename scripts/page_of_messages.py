"""Messages of the `.proto` files with their comments, for docs/reference/wire-contract.md."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from google.protobuf.descriptor_pb2 import (
    DescriptorProto,
    EnumDescriptorProto,
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
)
from helios_core.topics import METHODS, TOPICS, settings_method, spans_method, status_topic

from scripts.generate_proto import PROTO_ROOT, foxglove_descriptors
from scripts.markdown_tables import code, plain, sentence, table, unit_of

FILES = ("common", "robot", "frame", "search", "map", "task", "trace")
PACKAGE = ".helios.v1."
HEAD = ("number", "field", "type", "unit", "meaning")
# Field numbers in descriptor.proto; the path of a declaration alternates them with indices.
MESSAGES, ENUMS, FIELDS, NESTED, VALUES, SYNTAX = (4,), (5,), (2,), (3,), (2,), (12,)


@dataclass(frozen=True)
class Comments:
    """Comments before and behind each declaration of a file."""

    by_place: dict[tuple[int, ...], str]

    @classmethod
    def of(cls, file: FileDescriptorProto) -> Comments:
        found = {}
        for location in file.source_code_info.location:
            parts = (*location.leading_detached_comments, location.leading_comments)
            if tuple(location.path) != SYNTAX:  # only the file's own comment is detached
                parts = (location.leading_comments, location.trailing_comments)
            found[tuple(location.path)] = " ".join(" ".join(parts).split())
        return cls(found)

    def at(self, *place: int) -> str:
        """Comment at a path, as one Markdown paragraph; empty without a comment."""
        text = self.by_place.get(place, "")
        return plain(sentence(text)) if text else ""


def messages() -> str:
    """One section per file, with its messages in file order."""
    return "\n".join(section for file in described() for section in _file(file))


def described() -> list[FileDescriptorProto]:
    """Descriptors of the files, comments included."""
    sources = [f"helios/v1/{name}.proto" for name in FILES]
    with tempfile.TemporaryDirectory() as scratch:
        base, full = Path(scratch) / "foxglove.binpb", Path(scratch) / "all.binpb"
        base.write_bytes(foxglove_descriptors().SerializeToString())
        subprocess.run(
            [
                sys.executable,
                "-m",
                "grpc_tools.protoc",
                f"--descriptor_set_in={base}",
                f"--proto_path={PROTO_ROOT}",
                "--include_source_info",
                f"--descriptor_set_out={full}",
                *sources,
            ],
            check=True,
        )
        files = {file.name: file for file in FileDescriptorSet.FromString(full.read_bytes()).file}
    return [files[source] for source in sources]


def _file(file: FileDescriptorProto) -> Iterator[str]:
    comments = Comments.of(file)
    yield f"### {file.name}\n"
    yield f"{comments.at(*SYNTAX)}\n"
    for at, enum in enumerate(file.enum_type):
        yield _enum(enum, comments, (*ENUMS, at))
    for at, message in enumerate(file.message_type):
        yield _message(message, comments, (*MESSAGES, at))


def _enum(enum: EnumDescriptorProto, comments: Comments, place: tuple[int, ...]) -> str:
    rows = (
        (str(value.number), code(value.name), comments.at(*place, *VALUES, at))
        for at, value in enumerate(enum.value)
    )
    return f"({_label(enum.name)})=\n#### {enum.name}\n\n" + table(
        ("number", "value", "meaning"), rows
    )


def _message(message: DescriptorProto, comments: Comments, place: tuple[int, ...]) -> str:
    out = [f"({_label(message.name)})=\n#### {message.name}\n"]
    if words := comments.at(*place):
        out.append(f"{words}\n")
    if carried := _carried(message.name):
        out.append(f"On {carried}.\n")
    if message.field:
        out.append(table(HEAD, _rows(message, comments, place)))
    else:
        out.append("It has no fields.\n")
    for at, inner in enumerate(message.nested_type):
        if not inner.options.map_entry:
            inner_place = (*place, *NESTED, at)
            rows = list(_rows(inner, comments, inner_place))
            out.append(f"`{message.name}.{inner.name}`:{'' if rows else ' it has no fields.'}\n")
            out += [table(HEAD, rows)] if rows else []
    return "\n".join(out)


def _rows(
    message: DescriptorProto, comments: Comments, place: tuple[int, ...]
) -> Iterator[tuple[str, ...]]:
    for at, field in enumerate(message.field):
        meaning = comments.at(*place, *FIELDS, at)
        if field.HasField("oneof_index") and not field.proto3_optional:
            meaning = f"One of `{message.oneof_decl[field.oneof_index].name}`. {meaning}".strip()
        yield (
            str(field.number),
            code(field.name),
            _type(field, message),
            unit_of(field.name),
            meaning,
        )


def _type(field: FieldDescriptorProto, message: DescriptorProto) -> str:
    """Type as in the .proto file; one of our messages as a link to its section."""
    for inner in message.nested_type:
        if inner.options.map_entry and field.type_name.endswith(f".{message.name}.{inner.name}"):
            key, value = inner.field
            return f"map of {_type(key, inner)} to {_type(value, inner)}"
    name = field.type_name
    if not name:
        kind = FieldDescriptorProto.Type.Name(field.type).removeprefix("TYPE_").lower()
    elif name.startswith(PACKAGE):
        short = name.removeprefix(PACKAGE)
        kind = code(short) if "." in short else f"[{short}](#{_label(short)})"
    else:
        kind = code(name.removeprefix("."))
    repeated = field.label == FieldDescriptorProto.LABEL_REPEATED
    return f"repeated {kind}" if repeated else f"optional {kind}" if field.proto3_optional else kind


def _carried(name: str) -> str:
    """Keys whose payload is the message; empty for `Empty`."""
    topics = (*TOPICS, status_topic("<service>"))
    methods = (*METHODS, settings_method("<service>"), spans_method("<service>"))
    data = [code(t.name) for t in topics if t.type.DESCRIPTOR.name == name]
    requests = [code(m.name) for m in methods if m.request.DESCRIPTOR.name == name]
    replies = [code(m.name) for m in methods if m.reply.DESCRIPTOR.name == name]
    if name == "Empty":
        return ""
    parts = [", ".join(data)] * bool(data)
    parts += [f"requests of {', '.join(requests)}"] * bool(requests)
    parts += [f"replies of {', '.join(replies)}"] * bool(replies)
    return "; ".join(parts)


def _label(name: str) -> str:
    return f"message-{name.lower()}"
