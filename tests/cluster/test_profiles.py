"""Addresses of clusters, profiles of Slurm and Kubernetes, and mistakes in one line."""

import json
from pathlib import Path

import jsonschema
import pytest
import yaml

from lightwell.cli import main
from lightwell.cluster.connect import read_profile, security_of
from lightwell.core.cluster_options import parse_cluster

EXAMPLES = Path(__file__).parents[2] / "examples/cluster"


@pytest.mark.parametrize("text", ["local:4", "tcp://host:8786", "tls://10.0.0.1:8786", "ssh:hosts", "slurm:a.toml"])
def test_addresses_of_clusters(text):
    assert parse_cluster(text) == text


@pytest.mark.parametrize("text", ["local", "local:0", "local:x", "tcp:host", "tcp://host", "http://host:1", "", "ssh:"])
def test_other_addresses_are_refused(text):
    with pytest.raises(ValueError, match="is no cluster; write local:4"):
        parse_cluster(text)


def test_mistakes_are_one_line(tmp_path, capsys):
    out = str(tmp_path / "x.png")
    for where, told in (
        ("local:none", "is no cluster"),
        (f"ssh:{tmp_path / 'none'}", "asyncssh"),
        (f"slurm:{tmp_path / 'none.toml'}", "cannot read"),
        (f"k8s:{tmp_path / 'none.toml'}", "dask-kubernetes"),
        ("tcp://127.0.0.1:9", "no scheduler answers"),
    ):
        if where.startswith("tcp"):
            continue  # It waits half a minute for an answer: a slow test.
        assert main(["render", "cornell", "-o", out, "--size", "8x8", "--spp", "2", "--cluster", where]) == 2
        error = capsys.readouterr().err
        assert told in error and error.count("\n") == 1


def test_missing_certificates_are_named(tmp_path):
    with pytest.raises(ValueError, match=r"there is no '.*ca.pem'; the folder holds ca.pem, cert.pem, key.pem"):
        security_of(tmp_path)


def test_workers_of_a_profile_are_those_of_dasks_class(tmp_path):
    path = tmp_path / "a.toml"
    path.write_text('workers = 8\nname = "mine"\n')
    assert read_profile(str(path), "k8s") == {"n_workers": 8, "name": "mine"}
    assert read_profile(str(path), "slurm") == {"workers": 8, "name": "mine"}
    path.write_text("n_workers = 3\n")
    assert read_profile(str(path), "k8s") == {"n_workers": 3}
    path.write_text('workers = "many"\n')
    with pytest.raises(ValueError, match=r"--cluster k8s: workers = 'many' in '.*' is no count; write"):
        read_profile(str(path), "k8s")


def test_the_job_script_of_the_slurm_example():
    from dask_jobqueue import SLURMCluster

    options = read_profile(str(EXAMPLES / "slurm.toml"), "slurm")
    assert options.pop("workers") == 8
    with SLURMCluster(**options, interface="lo") as cluster:
        script = cluster.job_script()
    for line in ("#SBATCH -p short", "#SBATCH --cpus-per-task=16", "#SBATCH --mem=30G", "#SBATCH -t 01:00:00",
                 "#SBATCH --hint=nomultithread"):  # fmt: skip
        assert line in script
    assert "dask_worker" in script or "dask worker" in script


def test_the_kubernetes_manifest_follows_the_published_schema():
    documents = list(yaml.safe_load_all((EXAMPLES / "kubernetes.yaml").read_text()))
    assert [document["kind"] for document in documents] == ["Deployment", "Service", "Deployment"]
    schema = json.loads((Path(__file__).parent / "kubernetes-1.30.json").read_text())
    kinds = {"Deployment": "io.k8s.api.apps.v1.Deployment", "Service": "io.k8s.api.core.v1.Service"}

    def check(document):
        jsonschema.validate(document, schema | {"$ref": f"#/definitions/{kinds[document['kind']]}"})

    for document in documents:
        check(document)
    broken = documents[1] | {"spec": documents[1]["spec"] | {"port": 8786}}
    with pytest.raises(jsonschema.ValidationError):
        check(broken)
