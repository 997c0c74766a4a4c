"""The fast path of the neuron equations: batches of sparse rows through layers, gradients back, updates.

Contract: dse.engine.member says what an engine trains and reports; `cpu` and `autograd` are two. In integer
arithmetic states and spikes equal dse.engine.neurons bit for bit, and a network's numbers do not depend on
its neighbours. From below: vectors (values in Numba), layout (blocks of columns), kernels (the loops), events
and batch (what goes in), parameters (what a matrix follows from), layers (forward), learning (backward),
network (whole stacks), cpu (cohorts).
"""
