"""Contract tests: what a component must do, for the shipped ones and for your own.

    from dse.testing import check_family as check_family
    def test_my_family():
        check_family(MyFamily(size=4))

Every check takes a component, makes the small data that it needs, and raises an `AssertionError` with one
sentence that says what is violated. The contracts are Protocols: of sources, encoders and families in
`dse.config.contracts`, of losses in `dse.engine.losses`, of neurons in `dse.engine.neurons`, of samplers in
`dse.search.proposals`, of objectives in `dse.measure.objectives`, of kinds of hardware in
`dse.measure.hardware.profile`, of figures in `dse.show.figures`, of targets in `dse.deploy.targets`, of views
in `dse.show.dashboard.views`.
"""

from dse.testing.chips import check_chip_kind as check_chip_kind
from dse.testing.encoders import check_encoder as check_encoder
from dse.testing.families import check_family as check_family
from dse.testing.figures import check_figure as check_figure
from dse.testing.losses import check_loss as check_loss
from dse.testing.neurons import check_neuron as check_neuron
from dse.testing.objectives import check_objective as check_objective
from dse.testing.samplers import check_sampler as check_sampler
from dse.testing.sources import check_source as check_source
from dse.testing.targets import check_target as check_target
from dse.testing.views import check_view as check_view
