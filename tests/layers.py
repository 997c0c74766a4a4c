"""Parameters of stored layers, as tests write them."""

from dse.engine.neurons import cuba_lif, parameters_of


def cuba_parameters(decay_current, decay_voltage, threshold):
    """Return the parameters of a layer of CUBA-LIF neurons."""
    return parameters_of(cuba_lif.Population(decay_current, decay_voltage, threshold))
