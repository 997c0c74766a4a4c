"""Dense CUBA-LIF networks: settings, initialisation, training, responses, coarser weights."""
