"""Events in, spikes out: crops, bins of time, pools of space, one pass over the events, never a dense frame.

    count[b, p, j, i] = number of events of polarity p with  b = floor((t - t_0 - start) / bin)
                        and a pixel (x, y) in pool (i, j)
    spike[b, p, j, i] = 1 where count >= pool_threshold  (count > pool_threshold where `exceeds`)

Bins are half open: an event on a border belongs to the later bin. t_0 is the time of the recording's first
event, so that the time before it carries no information; a simulated trial has t_0 = 0. `time_ms` keeps
events with start <= t - t_0 < end; the last bin may be partly empty. A pixel counts in every pool that holds
it: pools overlap where the stride is smaller than the kernel, and leave pixels out where it is larger
(`dse.data.recordings.pooling` states their places, with padding and crop). Counts stop at 255. Spike channel
(p height + j) width + i of the pooled frame; p is 0 for OFF and 1 for ON where polarities are split, else 0.
A recording without events has no bins; bins without events have no spikes.

With `every_event` there is no counting: each event is a spike of every pool that holds its pixel, at its own
time.
"""

from dse.data.preprocessing.pins import count_pixels as count_pixels
from dse.data.preprocessing.pins import pin_rectangle as pin_rectangle
from dse.data.preprocessing.pools import END_OF_TIME_US as END_OF_TIME_US
from dse.data.preprocessing.pools import Pooling as Pooling
from dse.data.preprocessing.streaming import Survey as Survey
from dse.data.preprocessing.streaming import pool as pool
from dse.data.preprocessing.streaming import pool_events as pool_events
from dse.data.preprocessing.streaming import survey as survey
from dse.data.preprocessing.streaming import without_quiet as without_quiet
