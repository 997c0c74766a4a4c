"""The fast path of the neuron equations: batches of sparse rows through layers, and back.

Contract: `forward`, `backward` and the network functions built on them take arrays and return
arrays; in integer arithmetic their states and spikes equal dse.neurons bit for bit.
"""
