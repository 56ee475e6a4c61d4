"""Whoever trains another method notices nothing: importing ours changes nothing."""

import subprocess
import sys

import pytest

MODULES = """
import sys
import desplat_ns.method_configs
print(*(name for name in sys.modules if not name.startswith("desplat_ns")))
"""
"""What comes with the methods, by its own doing."""

COMPARED = """
import importlib, os, signal, sys, types, warnings

for name in MODULES:
    try:
        importlib.import_module(name)
    except Exception:
        pass
import PIL.Image, torch, yaml
from nerfstudio.configs import external_methods

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
    listed = subprocess.run([sys.executable, "-c", MODULES], capture_output=True, text=True)
    modules = [name for name in listed.stdout.split() if not name.startswith("__")]
    assert "torch" in modules, listed.stderr
    program = COMPARED.replace("MODULES", repr(modules))
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
