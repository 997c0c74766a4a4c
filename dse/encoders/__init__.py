"""Encoders: sampled signals in, spikes out.

A component of section `encoders` is a frozen dataclass; to add one, add one file here that registers it.

    n_channels(n_in) -> int
        spike channels that n_in sampled channels become
    positions(inputs) -> Array
        x, y and plane of the sampled channels, (n_in, 3) int32, become those of the spike channels,
        (n_channels, 3); planes tell the copies of a channel apart
    encode_all(signals, first, length) -> Spikes
        spikes of the steps first[i] .. first[i] + length[i] - 1 of recording i, each (n,); a step of the
        signals is a step of the spikes

Two more are optional:

    fitted(signals, first, n_steps, target, n_classes, train) -> Self
        the encoder with what it learns from the training recordings `train`, in the windows of n_steps
        steps that begin at `first`; target (n,) holds their classes, and -1 for all other recordings. What
        is learnt are numbers, texts or (nested) tuples of them in fields of its own, `param(axis=False)`:
        they are recorded with the design, and new recordings are encoded with them.
    transductive -> bool
        whether an encoder reads the label of the recording that it encodes. It is shown the labels of all
        recordings of the split then, and the same signals in `fitted` and in one call of `encode_all`.

Recordings that are spikes already, rasters and events after preprocessing, may pass an encoder too. They are
signals of 0 and 1 then, without label columns, from the first step that is stored of them to the end of the
last window. What an encoder cannot do it says as a ValueError of one sentence.
"""
