"""`helios certs`: folder, permissions, names, renewal, expiry; and `helios doctor` about them."""

from __future__ import annotations

import datetime as dt
import json
import os
import stat
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID
from helios_client.certs import folder as files
from helios_client.certs.folder import WARN_DAYS, create, credentials_of
from helios_client.certs.names import MOST_DAYS, Names, checked_hosts, from_toml, to_toml
from helios_client.cli import run
from helios_client.commands.certs import warnings
from helios_client.commands.doctor import examine
from helios_core.errors import Conflict, HeliosError, InvalidInput
from helios_core.router_link import RouterLink, listen_port, router_link
from helios_core.zenoh_config import client_config
from hypothesis import given, settings
from hypothesis import strategies as st

NOW = dt.datetime.now(dt.UTC)
NAMES = Names(("10.0.0.2", "server.local"), 7447, 365).with_robots(("robot",), (), False)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    out = tmp_path / "certs"
    create(out, NAMES, 3650, NOW)
    return out


def certificate(file: Path) -> x509.Certificate:
    return x509.load_pem_x509_certificate(credentials_of(file).certificate)


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


# --- init -----------------------------------------------------------------------------------------
def test_init_creates_one_name_per_service_robot_and_operator(tmp_path: Path) -> None:
    out = tmp_path / "a" / "certs"
    command = ["certs", "init", str(out), "--hosts", "10.0.0.2,hub", "--robots", "r1,r2"]
    assert (
        run(
            [
                *command,
                "--operators",
                "ann,ben",
                "--programs",
                "drive",
                "--simulation",
                "--shared",
                "gateway",
            ]
        )
        == 0
    )
    names = {file.stem for file in (out / "sessions").iterdir()}
    per_robot = (
        "bridge", "detector", "objectmap", "map2d", "planner", "recorder", "ros2", "supervisor",
        "robot", "world", "evaluation",
    )  # fmt: skip
    assert names == {f"{s}.{r}" for s in per_robot for r in ("r1", "r2")} | {
        "gateway.r1",
        "operator.ann",
        "operator.ben",
        "program.drive",
    }
    for file in (out / "sessions").iterdir():
        [cn] = certificate(file).subject.get_attributes_for_oid(NameOID.COMMON_NAME)
        assert cn.value == file.stem
        assert json.loads(file.read_text())["connect"]["endpoints"] == [
            "tls/10.0.0.2:7447",
            "tls/hub:7447",
        ]


def test_only_the_owner_can_use_the_folder_whatever_the_umask(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        create(tmp_path / "certs", NAMES, 9, NOW)
    finally:
        os.umask(before)
    for path in (tmp_path / "certs", *(tmp_path / "certs").rglob("*")):
        public = path.name == "ca.pem"
        assert mode(path) == (0o700 if path.is_dir() else 0o644 if public else 0o600), path


def test_init_refuses_to_overwrite(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = {p: p.read_bytes() for p in folder.rglob("*") if p.is_file()}
    assert run(["certs", "init", str(folder)]) == 1
    assert "is not empty; choose another folder" in capsys.readouterr().err
    assert run(["certs", "init", str(folder / "ca.pem")]) == 1
    assert {p: p.read_bytes() for p in folder.rglob("*") if p.is_file()} == before
    assert list(folder.parent.iterdir()) == [folder]


def test_a_failed_init_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(files, "access_control", full)
    with pytest.raises(InvalidInput, match="No space left"):
        create(tmp_path / "certs", NAMES, 9, NOW)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (["--hosts", "a b"], "no machine can be called 'a b'"),
        (["--hosts", "10.0.0.300"], "no machine can be called"),
        (["--hosts", ","], "no host came"),
        (["--robots", ","], "names no robot"),
        (["--robots", "a/b"], "no robot can be called"),
        (["--robots", "größe"], "no certificate can be called"),
        (["--robots", "r" * 80], "at most 64 characters"),
        (["--operators", "ann/../../x"], "no certificate can be called"),
        (["--operators", "ann,ann"], ""),
        (["--shared", "map2d"], "only detector and gateway can"),
        (["--days", "0"], "greater than or equal to 1"),
    ],
)
def test_init_refuses_wrong_words(
    tmp_path: Path, flags: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    code = run(["certs", "init", str(tmp_path / "certs"), *flags])
    assert code == (2 if says else 0)
    assert says in capsys.readouterr().err
    assert (tmp_path / "certs").exists() == (code == 0)


# --- certificates ---------------------------------------------------------------------------------
def test_the_router_serves_and_all_others_are_clients(folder: Path) -> None:
    def purposes(file: Path) -> list[x509.ObjectIdentifier]:
        return list(
            certificate(file).extensions.get_extension_for_class(x509.ExtendedKeyUsage).value
        )

    assert purposes(folder / "router.json5") == [ExtendedKeyUsageOID.SERVER_AUTH]
    for file in (folder / "sessions").iterdir():
        assert purposes(file) == [ExtendedKeyUsageOID.CLIENT_AUTH]
        basic = certificate(file).extensions.get_extension_for_class(x509.BasicConstraints)
        assert basic.value.ca is False


def test_the_router_is_known_by_its_hosts_and_on_its_own_machine(folder: Path) -> None:
    names = certificate(folder / "router.json5").extensions.get_extension_for_class(
        x509.SubjectAlternativeName
    )
    hosts = names.value.get_values_for_type(x509.DNSName)
    addresses = [str(a) for a in names.value.get_values_for_type(x509.IPAddress)]
    assert hosts == ["server.local", "localhost"]
    assert addresses == ["10.0.0.2", "127.0.0.1", "::1"]


def test_lifetimes_are_ten_years_and_one_and_never_longer_than_the_authoritys(
    folder: Path, tmp_path: Path
) -> None:
    days = {v.name: round(v.days_left(NOW)) for v in files.validities(folder)}
    assert days.pop("helios-ca") == 3650
    assert set(days.values()) == {365}
    create(tmp_path / "short", NAMES, 20, NOW)
    assert {round(v.days_left(NOW)) for v in files.validities(tmp_path / "short")} == {20}


# --- add and renew --------------------------------------------------------------------------------
def test_add_issues_new_names_and_leaves_the_others_alone(folder: Path) -> None:
    before = {f.name: f.read_bytes() for f in (folder / "sessions").iterdir()}
    router = credentials_of(folder / "router.json5")
    assert run(["certs", "add", str(folder), "--robots", "r2", "--shared", "detector"]) == 0
    assert run(["certs", "add", str(folder), "--operators", "ann", "--simulation"]) == 0
    after = {f.name: f.read_bytes() for f in (folder / "sessions").iterdir()}
    assert after.items() > before.items()
    assert after.keys() > {
        "map2d.r2.json5",
        "operator.ann.json5",
        "world.r2.json5",
        "world.robot.json5",
    }
    assert "detector.r2.json5" not in after
    assert credentials_of(folder / "router.json5") == router
    rules = json.loads((folder / "router.json5").read_text())["access_control"]["rules"]
    shared = {k for r in rules if r["id"].startswith("detector.robot-") for k in r["key_exprs"]}
    assert {key.split("/")[2] for key in shared} == {"robot", "r2", "_detectors"}


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        ([], "nothing to add"),
        (["--robots", "robot"], "robot has certificates already"),
        (["--operators", "a b"], "no certificate can be called"),
        (["--operators", "ann", "--shared", "gateway"], "name them"),
    ],
)
def test_add_refuses_what_is_there_or_wrong(
    folder: Path, flags: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["certs", "add", str(folder), *flags]) != 0
    assert says in capsys.readouterr().err


def test_concurrent_adds_lose_no_name(folder: Path) -> None:
    people = [f"p{i}" for i in range(6)]

    def add(person: str) -> None:
        files.add(folder, lambda names: names.with_people((person,)), NOW)

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(add, people))
    listed = {c.name for c in files.read_names(folder).certificates}
    assert listed >= {f"operator.{person}" for person in people}


def test_renew_replaces_keys_and_keeps_names(folder: Path) -> None:
    old = {
        v.name: credentials_of(v.file) for v in files.validities(folder) if v.file.suffix != ".pem"
    }
    assert run(["certs", "renew", str(folder), "map2d.robot", "router"]) == 0
    some = {n: credentials_of(folder / "sessions" / f"{n}.json5") for n in old if n != "router"}
    some["router"] = credentials_of(folder / "router.json5")
    assert {name for name in old if old[name] != some[name]} == {"map2d.robot", "router"}
    assert run(["certs", "renew", str(folder), "--days", "30", "--hosts", "10.9.9.9"]) == 0
    now = {v.name: v for v in files.validities(folder)}
    assert now.keys() == {"helios-ca", *old}
    assert all(v.days_left(NOW) < 31 for n, v in now.items() if n != "helios-ca")
    values = json.loads((folder / "sessions" / "map2d.robot.json5").read_text())
    assert values["connect"]["endpoints"] == ["tls/10.9.9.9:7447"]


@pytest.mark.parametrize("hosts", [",", "", "a b"])
def test_renew_with_wrong_hosts_renews_nothing(
    folder: Path, hosts: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before = credentials_of(folder / "router.json5")
    assert run(["certs", "renew", str(folder), "--hosts", hosts]) == 2
    assert "such as" in capsys.readouterr().err
    assert credentials_of(folder / "router.json5") == before


def test_remove_takes_the_file_and_the_rights(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["certs", "add", str(folder), "--operators", "ann"]) == 0
    assert run(["certs", "remove", str(folder), "operator.ann", "robot.robot"]) == 0
    left = {file.stem for file in (folder / "sessions").iterdir()}
    assert not left & {"operator.ann", "robot.robot"}
    access = json.loads((folder / "router.json5").read_text())["access_control"]
    assert {subject["id"] for subject in access["subjects"]} == left
    assert run(["certs", "remove", str(folder), "router"]) == 2
    assert "no certificate is called router" in capsys.readouterr().err


def test_renew_needs_known_names_and_the_authoritys_private_key(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["certs", "renew", str(folder), "map3d.robot"]) == 2
    assert "no certificate is called map3d.robot" in capsys.readouterr().err
    (folder / "ca.key").chmod(0o640)
    assert run(["certs", "renew", str(folder)]) == 1
    assert f"chmod 600 {folder / 'ca.key'}" in capsys.readouterr().err
    (folder / "ca.key").unlink()
    assert run(["certs", "renew", str(folder)]) == 1
    assert "has no ca.key; run this on the machine of helios certs init" in capsys.readouterr().err
    assert run(["certs", "renew", str(folder.parent / "none")]) == 1
    assert "there is no folder" in capsys.readouterr().err


def test_a_key_of_another_authority_issues_nothing(folder: Path, tmp_path: Path) -> None:
    create(tmp_path / "other", NAMES, 9, NOW)
    (folder / "ca.key").write_bytes((tmp_path / "other" / "ca.key").read_bytes())
    with pytest.raises(InvalidInput, match=r"ca\.key is not the key of ca\.pem"):
        files.renew(folder, (), NOW, lambda names: names)


@pytest.mark.parametrize("name", ["ca.pem", "ca.key", "names.toml", "router.json5"])
@pytest.mark.parametrize(
    "content", [b"", b"\xff\xfe", b"{}", b"[1]", b"-----BEGIN", b'{"transport": 1}']
)
def test_damaged_files_are_refused_with_a_sentence(folder: Path, name: str, content: bytes) -> None:
    (folder / name).write_bytes(content)
    with pytest.raises(HeliosError):
        files.renew(folder, ("map2d.robot",), NOW, lambda names: names)


# --- show and doctor ------------------------------------------------------------------------------
def test_show_lists_expiries_and_warns_thirty_days_before(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["certs", "show", str(folder), "--json"]) == 0
    out, err = capsys.readouterr()
    shown = {c["name"]: c["days_left"] for c in json.loads(out)["certificates"]}
    assert shown["map2d.robot"] == pytest.approx(365, abs=0.2)
    assert err == ""
    assert run(["certs", "renew", str(folder), "map2d.robot", "--days", "29"]) == 0
    capsys.readouterr()
    assert run(["certs", "show", str(folder)]) == 0
    out, err = capsys.readouterr()
    assert "map2d.robot" in out
    assert f"map2d.robot expires in 29 days; renew it: helios certs renew {folder}" in err
    assert "planner.robot" not in err


@given(st.floats(-400, 400))
@settings(max_examples=50)
def test_every_certificate_with_less_than_thirty_days_is_named(days: float) -> None:
    found = [files.Validity("x.y", Path("sessions/x.y.json5"), NOW + dt.timedelta(days=days))]
    said = warnings(Path("certs"), found, NOW)
    left = found[0].days_left(NOW)
    assert bool(said) == (left < WARN_DAYS)
    assert all(("has expired" in s) == (left <= 0) for s in said)


def test_show_works_in_a_copy_of_one_session_file(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = tmp_path / "robot" / "sessions"
    copy.mkdir(parents=True)
    (copy / "bridge.robot.json5").write_bytes(
        (folder / "sessions" / "bridge.robot.json5").read_bytes()
    )
    (copy / "bridge.robot.json5").chmod(0o600)
    assert run(["certs", "show", str(copy.parent)]) == 0
    assert "bridge.robot" in capsys.readouterr().out
    assert run(["certs", "show", str(tmp_path / "robot" / "none")]) == 1
    assert "has no certificates" in capsys.readouterr().err


def test_doctor_names_expiring_stale_and_readable_certificates(folder: Path) -> None:
    def said() -> list[str]:
        found = examine(65000, certs=folder)
        return [f.remedy for f in found if f.what == f"certificates in {folder}" and not f.ok]

    assert said() == []
    files.renew(folder, ("planner.robot",), NOW - dt.timedelta(days=400), lambda names: names)
    assert ["planner.robot has expired" in text for text in said()] == [True]
    router = json.loads((folder / "router.json5").read_text())
    router["access_control"]["rules"].pop()
    (folder / "router.json5").write_text(json.dumps(router))
    assert any("not those of this version" in text for text in said())
    (folder / "router.json5").chmod(0o644)
    assert any("chmod 600" in text for text in said())


# --- names.toml -----------------------------------------------------------------------------------
words = st.from_regex(r"[A-Za-z0-9][A-Za-z0-9_-]{0,12}", fullmatch=True)


@given(
    st.lists(words, min_size=1, max_size=3, unique=True),
    st.lists(words, max_size=3, unique=True),
    st.sets(st.sampled_from(["detector", "gateway"])),
    st.booleans(),
    st.integers(1, 65535),
)
def test_names_survive_the_file(
    robots: list[str], people: list[str], shared: set[str], simulated: bool, port: int
) -> None:
    names = Names(("10.0.0.2", "hub"), port, 365).with_robots(robots, tuple(shared), simulated)
    names = names.with_people(people, ["drive"])
    assert from_toml(to_toml(names)) == names
    assert len({c.name for c in names.certificates}) == len(names.certificates)
    for identity in names.identities:
        assert identity.robots


@given(st.text(max_size=40))
def test_any_text_is_a_host_or_refused(text: str) -> None:
    try:
        [host] = checked_hosts([text])
    except InvalidInput:
        return
    assert host == text
    assert not set(text) & set(" /#;=?\n\"'")


@pytest.mark.parametrize(
    "name",
    ["../../x", "/x", "a/b", "a\\b", "", ".", "..", "-", "map2d.robot\n", "größe", "a b", "x" * 65],
)
def test_renew_refuses_a_name_that_is_no_file_name_and_writes_nothing(
    name: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    listed = folder / "names.toml"
    entry = f'\n[[certificate]]\nname = {json.dumps(name)}\nservice = "map2d"\nrobots = ["robot"]\n'
    listed.write_text(listed.read_text() + entry)
    before = {p: p.read_bytes() for p in folder.parent.rglob("*") if p.is_file()}
    assert run(["certs", "renew", str(folder)]) == 1
    assert f"names.toml has a certificate {name!r}; wanted letters" in capsys.readouterr().err
    assert {p: p.read_bytes() for p in folder.parent.rglob("*") if p.is_file()} == before


def test_the_file_and_the_command_line_take_the_same_days(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = to_toml(NAMES)
    assert from_toml(text.replace("days = 365", f"days = {MOST_DAYS}")).days == MOST_DAYS
    assert run(["certs", "init", str(tmp_path / "long"), "--days", str(MOST_DAYS)]) == 0
    (folder / "names.toml").write_text(text.replace("days = 365", f"days = {MOST_DAYS + 1}"))
    assert run(["certs", "renew", str(folder)]) == 1
    assert f"names.toml is wrong: days: Input should be less than or equal to {MOST_DAYS}" in (
        capsys.readouterr().err
    )
    assert run(["certs", "init", str(tmp_path / "longer"), "--days", str(MOST_DAYS + 1)]) == 2


def test_a_robot_or_operator_cannot_be_added_twice() -> None:
    with pytest.raises(Conflict):
        NAMES.with_robots(("robot",), (), False)
    with pytest.raises(Conflict):
        NAMES.with_people(("ann",)).with_people(("ann",))


# --- what the services read -----------------------------------------------------------------------
def test_a_service_finds_its_own_file(folder: Path) -> None:
    link = router_link("", folder, "map2d", "robot")
    assert link == RouterLink("", folder / "sessions" / "map2d.robot.json5")
    config = json.loads(client_config(link).get_json("connect/endpoints"))
    assert config == ["tls/10.0.0.2:7447", "tls/server.local:7447"]
    config = client_config(router_link("tls/h:1", folder, "map2d", "robot"))
    assert json.loads(config.get_json("connect/endpoints")) == ["tls/h:1"]
    assert router_link("", folder / "sessions" / "map2d.robot.json5", "x", "y").session is not None
    assert listen_port(folder) == 7447
    # A detector for several robots has one file, whatever the bus is called.
    assert router_link("", folder, "detector", "_detectors").session is not None


def test_a_missing_shared_or_damaged_file_is_refused_with_the_remedy(folder: Path) -> None:
    with pytest.raises(InvalidInput, match=r"world\.robot\.json5 .*helios certs add DIR --simul"):
        router_link("", folder, "world", "robot")
    with pytest.raises(InvalidInput, match="takes no certificates"):
        router_link("tcp/10.0.0.2:7447", folder, "map2d", "robot")
    own = folder / "sessions" / "map2d.robot.json5"
    own.chmod(0o644)
    with pytest.raises(InvalidInput, match=rf"mode 0644\); run: chmod 600 {own}"):
        router_link("", folder, "map2d", "robot")
    own.chmod(0o600)
    own.write_text("no JSON")
    with pytest.raises(InvalidInput, match="no configuration of Zenoh"):
        client_config(RouterLink("", own))
