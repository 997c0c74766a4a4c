"""What could pass for skill in recordings and their split: shortcuts that cheap readers find in a minute.

Each file of probes is about one kind of shortcut: a few numbers per sample (spike totals, resting level,
length), position in time, and conditions of recording (twins, the identity of groups). A reader trains on the
training windows and answers on the validation windows, from the spikes that classifiers get. A row says what
it reaches, and which key removes the shortcut.
"""

from dse.study.audit.audit import Audit, audit, probe
from dse.study.audit.material import Levels, Material
from dse.study.audit.rows import AuditRow

__all__ = ["Audit", "AuditRow", "Levels", "Material", "audit", "probe"]
