# SPDX-License-Identifier: Apache-2.0
"""The Kubernetes templates of configs/launch.  Every object is checked against its published schema: of Kubernetes 1.37 (package kubernetes-validate), and
of the training operator (models of the package kubeflow-training).  Then their commands run here, each pod as a process, and a controller of this file
starts pods again by the rules of the manifest: a pod is killed and the number of workers changes, from 2 to 4 to 3.  With --schemas only the first part.
Ends with 77 (skipped) without the packages.

  k8s_templates_test.py EARSHOT [--schemas]
"""
import os
import pathlib
import signal
import subprocess
import sys
import tempfile

from elastic_runs import Run, free_port

try:
    import kubernetes.client.models as kubernetes_models
    import kubernetes_validate
    import kubeflow.training.models as kubeflow_models
    import yaml
except ImportError:
    kubernetes_validate = None


def check_by_model(value, type_name, where):
    """Names and types of a published model: an unknown field or a value of another type is an error."""
    if type_name.startswith("list["):
        assert isinstance(value, list), f"{where}: {value!r} is no list"
        for index, item in enumerate(value):
            check_by_model(item, type_name[5:-1], f"{where}[{index}]")
    elif type_name.startswith(("dict(", "dict[")):
        assert isinstance(value, dict), f"{where}: {value!r} is no map"
        inner = type_name[5:-1].split(",", 1)[1].strip()
        for key, item in value.items():
            check_by_model(item, inner, f"{where}.{key}")
    elif type_name in ("str", "int", "bool", "float", "object", "datetime"):
        python = {"str": str, "int": int, "bool": bool, "float": (int, float)}.get(type_name, object)
        assert isinstance(value, python), f"{where}: {value!r} is no {type_name}"
    else:
        model = getattr(kubeflow_models, type_name, None) or getattr(kubernetes_models, type_name)
        fields = {key: model.openapi_types[name] for name, key in model.attribute_map.items()}
        assert isinstance(value, dict), f"{where}: {value!r} is no object"
        for key, item in value.items():
            assert key in fields, f"{where}.{key} is not a field of {type_name}"
            check_by_model(item, fields[key], f"{where}.{key}")


def refused(check, document):
    try:
        check(document)
    except Exception:  # each package has errors of its own
        return True
    return False


def check_schemas(launch):
    by_kubernetes = lambda document: kubernetes_validate.validate(document, "1.37", strict=True)
    documents = list(yaml.safe_load_all((launch / "k8s-job.yaml").read_text()))
    assert [document["kind"] for document in documents] == ["Service", "ConfigMap", "Job"]
    for document in documents:
        by_kubernetes(document)
    job = documents[2]
    # The check finds what a misspelt template would have.
    assert refused(by_kubernetes, {**job, "spec": {**job["spec"], "podFailurePolicies": {}}})
    assert refused(by_kubernetes, {**job, "spec": {**job["spec"], "completions": "four"}})

    training = yaml.safe_load((launch / "k8s-pytorchjob.yaml").read_text())
    by_operator = lambda document: check_by_model(document, "KubeflowOrgV1PyTorchJob", document["kind"])
    by_operator(training)
    for replica in training["spec"]["pytorchReplicaSpecs"].values():
        # Its model of a pod allows what the schema of Kubernetes does not.
        by_kubernetes({"apiVersion": "v1", "kind": "PodTemplate", "metadata": {"name": "a"}, "template": replica["template"]})
        assert replica["restartPolicy"] in ("Always", "OnFailure", "Never", "ExitCode")
        assert [container["name"] for container in replica["template"]["spec"]["containers"]] == ["pytorch"]
    assert refused(by_operator, {**training, "spec": {**training["spec"], "elastic": {}}})


class Pods:
    """Pods of one manifest as processes; `again(code)` says whether a pod that ends so is started again."""

    def __init__(self, run, container, again, variables):
        port = free_port()
        place = lambda text: (text.replace("/runs/CONFIG.yaml", str(run.config)).replace("/runs/", f"{run.folder}/")
                              .replace("/keys/keys", str(run.keys)).replace("network.port_range=29400-29403", "network.port_range="))
        self.command = [place(part) for part in container["command"]]
        self.again, self.variables = again, variables
        self.environment = {**os.environ, "PATH": f"{pathlib.Path(run.earshot).parent}:{os.environ['PATH']}", "EARSHOT_RUN_ID": "uid",
                            "EARSHOT_RENDEZVOUS": f"tcp://127.0.0.1:{port}"}
        stated = {entry["name"] for entry in container["env"]}
        assert {"EARSHOT_RENDEZVOUS", "EARSHOT_RUN_ID"} <= stated
        self.size, self.running, self.done, self.codes = 0, {}, set(), []
        self.log = open(run.log, "a")

    def start(self, rank):
        environment = {**self.environment, **self.variables(rank, self.size)}
        self.running[rank] = subprocess.Popen(self.command, env=environment, stdout=self.log, stderr=self.log, stdin=subprocess.DEVNULL,
                                              start_new_session=True)

    def scale(self, size):
        """As the controller: pods beyond the new number are ended, missing ones started."""
        self.size = size
        for rank in [rank for rank in self.running if rank >= size]:
            self.running.pop(rank).terminate()
        for rank in range(size):
            if rank not in self.running and rank not in self.done:
                self.start(rank)

    def look(self):
        for rank, process in list(self.running.items()):
            code = process.poll()
            if code is None:
                continue
            code = 128 - code if code < 0 else code
            self.codes.append(code)
            del self.running[rank]
            if code == 0:
                self.done.add(rank)
                continue
            assert self.again(code), f"pod {rank} ended with code {code}, and the manifest ends the run"
            if rank < self.size:
                self.start(rank)

    def kill(self, rank, number):
        os.killpg(self.running[rank].pid, number)

    def end(self):
        for process in self.running.values():
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def check_run(earshot, container, again, variables):
    """2 workers, of which one is killed; then 4; then 3, to the end."""
    with tempfile.TemporaryDirectory() as name:
        run = Run(name, earshot)
        pods = Pods(run, container, again, variables)
        try:
            pods.scale(2)
            run.wait_for(2, look=pods.look)
            before = run.newest()["update"]
            pods.kill(1, signal.SIGKILL)
            run.wait(lambda: run.newest()["update"] >= before + 5, "updates after a killed pod", pods.look)
            # A new size: pods that come wait until pod 0 is deleted, and with it the old run ends.
            for size in (4, 3):
                if size == 3:
                    run.end_soon(3)
                pods.scale(size)
                pods.kill(0, signal.SIGTERM)
                if size == 4:
                    run.wait_for(4, look=pods.look)
            run.wait(lambda: pods.done == set(range(3)), "the end", pods.look)
            points = run.check_curve([2, 4, 3])
            assert 137 in pods.codes and set(pods.codes) & {3, 138}, pods.codes
            print(f"2, 4, 3 workers: {len(points)} updates; pods ended with {pods.codes}")
        except AssertionError:
            print(run.said())
            raise
        finally:
            pods.end()


def main(earshot, only_schemas):
    launch = pathlib.Path(__file__).resolve().parents[2] / "configs" / "launch"
    check_schemas(launch)
    print("schemas: Kubernetes 1.37 and the training operator's models")
    if only_schemas:
        return
    job = list(yaml.safe_load_all((launch / "k8s-job.yaml").read_text()))[2]["spec"]

    def again_by_job(code):
        for rule in job["podFailurePolicy"]["rules"]:
            if code in rule.get("onExitCodes", {}).get("values", []):
                return rule["action"] != "FailJob"
        return True  # counts towards backoffLimit

    check_run(earshot, job["template"]["spec"]["containers"][0], again_by_job,
              lambda rank, size: {"JOB_COMPLETION_INDEX": str(rank), "EARSHOT_WORLD_SIZE": str(size)})
    training = yaml.safe_load((launch / "k8s-pytorchjob.yaml").read_text())
    container = training["spec"]["pytorchReplicaSpecs"]["Worker"]["template"]["spec"]["containers"][0]
    # The operator starts pods of restartPolicy ExitCode again from code 128 on.
    check_run(earshot, container, lambda code: code >= 128,
              lambda rank, size: {"RANK": str(rank), "WORLD_SIZE": str(size), "MASTER_ADDR": "127.0.0.1", "MASTER_PORT": "23456"})


if __name__ == "__main__":
    if kubernetes_validate is None:
        print("skipped: no python packages kubernetes-validate and kubeflow-training")
        sys.exit(77)
    main(os.path.abspath(sys.argv[1]), "--schemas" in sys.argv)
