"""Which plugins there are: the files of this package's folders, and what other packages add through entry points."""

from __future__ import annotations

import importlib
import importlib.metadata
import inspect
import pkgutil
from functools import cache

from pipeline.errors import InputError
from pipeline.plugins.base import Baseline, Estimator, Exporter, Light, Medium, PhaseFunction, Plugin, Shape

BASES: dict[str, type[Plugin]] = {
    "shapes": Shape, "lights": Light, "media": Medium,
    "phase_functions": PhaseFunction, "estimators": Estimator, "exporters": Exporter, "baselines": Baseline,
}
KINDS = tuple(BASES)


@cache
def registry(kind: str) -> dict[str, type[Plugin]]:
    """All plugins of a kind by type name: this package's folder first, then entry points `fog.KIND`."""
    found: dict[str, type[Plugin]] = {}
    package = importlib.import_module(f"{__package__}.{kind}")
    for module_info in sorted(pkgutil.iter_modules(package.__path__), key=lambda m: m.name):
        module = importlib.import_module(f"{package.__name__}.{module_info.name}")
        for cls in vars(module).values():
            if inspect.isclass(cls) and issubclass(cls, BASES[kind]) and cls.__module__ == module.__name__:
                found[cls.type_name()] = cls
    for entry in importlib.metadata.entry_points(group=f"fog.{kind}"):
        place = f"entry point fog.{kind}:{entry.name}" + (f" of {entry.dist.name}" if entry.dist else "")
        try:
            cls = entry.load()
            is_one = inspect.isclass(cls) and issubclass(cls, BASES[kind]) and cls.type_name() == entry.name
        except Exception as error:  # a stranger's package may fail in any way; name it
            raise InputError(f"cannot be loaded ({type(error).__name__}: {error})", place=place,
                             remedy="mend or uninstall the package that provides it") from error
        if not is_one:
            raise InputError(f"is not a {BASES[kind].__name__} of type '{entry.name}'", place=place,
                             remedy="name the entry point after the plugin's type")
        if entry.name in found and found[entry.name] is not cls:
            raise InputError(f"'{entry.name}' exists already", place=place, remedy="choose another type name")
        found[entry.name] = cls
    return found
