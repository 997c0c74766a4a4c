"""The core knows by name what this plugin holds, to say where it is if the plugin is not installed."""

from dse.base import registry


def test_what_the_core_names_is_what_the_plugin_registers():
    held = {
        section: tuple(name for name, cls in known.items() if cls.__module__.startswith("dse_papers."))
        for section in registry.SECTIONS
        if (known := registry.known(section))
    }
    assert {section: names for section, names in held.items() if names} == registry.ELSEWHERE["dse-papers"]
