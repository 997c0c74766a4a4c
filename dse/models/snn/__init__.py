"""Dense spiking networks: settings, initialisation, training, responses, coarser weights."""
