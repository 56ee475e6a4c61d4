"""Whoever trains another method notices nothing: importing ours changes nothing."""

import subprocess
import sys

import pytest

COMPARED = """
import importlib, os, signal, sys, types, warnings
import PIL.Image, torch, yaml
from nerfstudio.configs import external_methods
from nerfstudio.models import splatfacto

reading, writing = os.pipe()
if os.fork() == 0:  # a process that says what else comes with the methods, by its own doing
    import desplat_ns.method_configs
    with open(writing, "w") as pipe:
        print(*(n for n in sys.modules if not n.startswith(("desplat_ns", "__"))), file=pipe)
    os._exit(0)
os.close(writing)
listed = open(reading).read().split()
os.wait()
assert "desplat_ns" not in sys.modules and len(listed) > 1000
for name in listed:
    try:
        importlib.import_module(name)
    except Exception:
        pass

def state():
    found = {
        "hook": sys.excepthook, "filters": list(warnings.filters),
        "threads": torch.get_num_threads(),
        "PIL": PIL.Image.MAX_IMAGE_PIXELS, "environment": dict(os.environ),
        "signals": [signal.getsignal(s) for s in (signal.SIGINT, signal.SIGTERM)],
        "inspect": external_methods.inspect, "path": list(sys.path),
        "yaml": {loader: (dict(vars(loader)), dict(loader.yaml_constructors))
                 for loader in (yaml.Loader, yaml.SafeLoader, yaml.FullLoader, yaml.UnsafeLoader)},
        "dumper": (dict(yaml.Dumper.yaml_representers), dict(yaml.Dumper.yaml_multi_representers)),
    }
    for name, module in list(sys.modules.items()):
        if name.partition(".")[0] in ("nerfstudio", "gsplat", "rich", "tyro", "torchmetrics"):
            for key, value in list(vars(module).items()):
                is_code = isinstance(value, (type, types.FunctionType))
                if is_code:
                    found[name, key] = value
                if isinstance(value, type) and value.__module__ == name:
                    found[name, key, "attributes"] = dict(vars(value))
    return found

before = state()
import desplat_ns.method_configs
after = state()
changed = [key for key in before if before[key] is not after[key] and before[key] != after[key]]
assert len(before) > 1000 and not changed, changed
assert not [name for name in sys.modules if name.startswith("desplat_ns.tools")]
"""


@pytest.mark.slow
def test_importing_the_methods_changes_nothing():
    done = subprocess.run([sys.executable, "-c", COMPARED], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
