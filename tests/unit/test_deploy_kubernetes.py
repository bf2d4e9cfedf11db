"""Tests that the manifests of `deploy/kubernetes` are valid and name what exists."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
from helios_core import health_probe
from helios_core.router import arguments as router_arguments

from tests.support import settings_of

yaml = pytest.importorskip("yaml", reason="PyYAML is not installed")
kubernetes_validate = pytest.importorskip(
    "kubernetes_validate", reason="kubernetes-validate is not installed"
)

FOLDER = Path(__file__).parents[2] / "deploy/kubernetes"
IMAGE = (FOLDER.parent / "Dockerfile").read_text()
KUSTOMIZATION: dict[str, Any] = yaml.safe_load((FOLDER / "kustomization.yaml").read_text())
SETTINGS = tomllib.loads((FOLDER / "helios.toml").read_text())
PAGE = (Path(__file__).parents[2] / "docs/how-to/containers.md").read_text()
SERVICES = ("bridge", "detector", "objectmap", "map2d", "planner", "gateway", "recorder")


def manifests(file: str) -> list[dict[str, Any]]:
    return [m for m in yaml.safe_load_all((FOLDER / file).read_text()) if m]


def pod(name: str) -> dict[str, Any]:
    return manifests(f"{name}.yaml")[0]["spec"]["template"]["spec"]


@pytest.mark.parametrize("file", KUSTOMIZATION["resources"])
def test_every_manifest_follows_the_schema_of_kubernetes(file: str) -> None:
    documents = manifests(file)
    assert documents
    for document in documents:
        kubernetes_validate.validate(document, "1.33", strict=True)


def test_the_schema_refuses_a_misspelt_field() -> None:
    wrong = manifests("planner.yaml")[0]
    wrong["spec"]["template"]["spec"]["containers"][0]["readinessProb"] = {}
    with pytest.raises(kubernetes_validate.ValidationError):
        kubernetes_validate.validate(wrong, "1.33", strict=True)


def test_every_file_of_the_folder_is_used() -> None:
    used = {"kustomization.yaml", *KUSTOMIZATION["resources"]}
    used |= {f for g in KUSTOMIZATION["configMapGenerator"] for f in g["files"]}
    assert {path.name for path in FOLDER.iterdir()} == used


@pytest.mark.parametrize("name", SERVICES)
def test_each_service_accepts_the_settings(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    [container] = pod(name)["containers"]
    for variable in container["env"]:
        at = FOLDER / "helios.toml" if variable["name"] == "HELIOS_CONFIG" else variable["value"]
        monkeypatch.setenv(variable["name"], str(at))
    module, *flags = container["args"]
    settings = settings_of(module).load(flags)
    assert settings.router == SETTINGS["all"]["router"]


def test_the_router_takes_its_flags() -> None:
    [container] = pod("router")["containers"]
    module, *flags = container["args"]
    assert module == "helios_core.router"
    folder = router_arguments().parse_args(flags).certs
    [copy] = pod("router")["initContainers"]
    assert copy["command"][-1] == f"{folder}/router.json5"


def test_the_settings_are_of_services_that_run_here() -> None:
    assert SETTINGS.keys() == {"all", *SERVICES}


@pytest.mark.parametrize("name", [*SERVICES, "router"])
def test_each_pod_runs_its_own_image_closed(name: str) -> None:
    spec = pod(name)
    assert f"\nFROM runtime AS {name}\n" in IMAGE
    assert spec["securityContext"]["runAsNonRoot"]
    # Else every start gives the group access to private files, which HELIOS then refuses.
    assert spec["securityContext"]["fsGroupChangePolicy"] == "OnRootMismatch"
    for container in [*spec["initContainers"], *spec["containers"]]:
        assert container["image"] == f"helios-{name}"
        closed = container["securityContext"]
        assert closed["readOnlyRootFilesystem"]
        assert not closed["allowPrivilegeEscalation"]
        assert closed["capabilities"] == {"drop": ["ALL"]}


@pytest.mark.parametrize("name", sorted({*SERVICES} - {"gateway"}))
def test_each_service_is_probed_by_its_own_name_and_no_dead_router_restarts_it(name: str) -> None:
    container = pod(name)["containers"][0]
    probe = ["python", "-m", "helios_core.health_probe", name]
    assert container["readinessProbe"]["exec"]["command"] == probe
    assert container["startupProbe"]["exec"]["command"] == probe
    assert container["livenessProbe"]["exec"]["command"] == [*probe, "--unless-cut-off"]
    assert name in health_probe.SERVICES


@pytest.mark.parametrize("name", SERVICES)
def test_each_service_has_a_secret_of_its_own_and_takes_its_session_from_it(name: str) -> None:
    spec = pod(name)
    [secret] = [v["secret"]["secretName"] for v in spec["volumes"] if "secret" in v]
    assert secret == f"helios-{name}"
    [copy] = spec["initContainers"]
    mounted = {m["name"]: m["mountPath"] for m in copy["volumeMounts"]}
    assert f"{mounted['secret']}/session.json5" in copy["command"]
    into = {mounted["private"], f"{mounted['private']}/session.json5"}
    assert into & {*copy["command"]}
    variables = {v["name"]: v.get("value") for v in spec["containers"][0]["env"]}
    assert variables[f"HELIOS_{name.upper()}_CERTS"] == f"{mounted['private']}/session.json5"


def test_the_page_makes_a_secret_for_each_service() -> None:
    [services] = re.findall(r"for service in (.*?);", PAGE)
    assert {*services.split(), "gateway"} == {*SERVICES}


KEPT = [
    (name, path)
    for name in SERVICES
    for path in SETTINGS[name].values()
    if str(path).startswith("/state/")
]


@pytest.mark.parametrize(("name", "path"), KEPT)
def test_what_a_service_keeps_is_on_a_volume_that_outlives_the_pod(name: str, path: str) -> None:
    spec, claims = pod(name), manifests(f"{name}.yaml")[1:]
    mounts = spec["containers"][0]["volumeMounts"]
    [mount] = [m for m in mounts if Path(path).is_relative_to(m["mountPath"])]
    [volume] = [v for v in spec["volumes"] if v["name"] == mount["name"]]
    claim = volume["persistentVolumeClaim"]["claimName"]
    assert claim in [c["metadata"]["name"] for c in claims]


def test_the_recorder_is_off_until_somebody_wants_a_recording() -> None:
    off = [name for name in SERVICES if manifests(f"{name}.yaml")[0]["spec"]["replicas"] == 0]
    assert off == ["recorder"]


def test_the_gateway_is_reached_while_the_robot_is_stopped() -> None:
    [service] = [m for m in manifests("gateway.yaml") if m["kind"] == "Service"]
    assert pod("gateway")["containers"][0]["readinessProbe"]["httpGet"]["path"] == "/readyz"
    assert service["spec"]["publishNotReadyAddresses"]


def test_only_the_services_may_leave_their_pods_and_only_for_the_router() -> None:
    policies = {p["metadata"]["name"]: p["spec"] for p in manifests("network-policies.yaml")}
    assert policies["deny-all"]["podSelector"] == {}
    leaving = [name for name, spec in policies.items() if spec.get("egress")]
    assert leaving == ["services-reach-the-router"]
    for name in SERVICES:
        labels = manifests(f"{name}.yaml")[0]["spec"]["template"]["metadata"]["labels"]
        assert labels["bus"] == "client"
