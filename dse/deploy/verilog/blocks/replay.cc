// Runs commands from stdin in the simulated core and writes what came of them: numbers of 32 bits.
//
// in, out: as of replay.c, but that layer is 1 and neurons are counted through all layers; and instead of the
//          counts of outputs come the clock cycles of all steps of the window, and of the longest
#include "core.cc"
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <vector>

enum { INIT, RESET, STEP, SPIKE, ANSWER = 7 };

static cxxrtl_design::p_core core;
static std::vector<int32_t> written;

// A clock cycle; returns whether the core was ready in it. Outputs are up to date once the clock is low.
static bool tick()
{
    core.p_clk.set<bool>(false);
    core.step();
    const bool ready = core.p_ready.get<bool>();
    if (core.p_spiked.get<bool>()) {
        written.insert(written.end(), {1, core.p_network__step.get<int32_t>(), core.p_neuron.get<int32_t>()});
    }
    core.p_clk.set<bool>(true);
    core.step();
    return ready;
}

// Give a strobe and wait until the core is ready again; returns the clock cycles.
template <class Signal> static int32_t strobe(Signal &signal)
{
    int32_t cycles = 0;
    signal.template set<bool>(true);
    tick();
    signal.template set<bool>(false);
    do {
        cycles++;
    } while (!tick());
    return cycles;
}

int main()
{
    std::vector<int32_t> commands;
    int32_t number, all = 0, longest = 0;
    while (fread(&number, sizeof number, 1, stdin) == 1) {
        commands.push_back(number);
    }
    while (!tick()) { // it is turned on
    }
    for (size_t i = 0; i < commands.size(); i++) {
        switch (commands[i]) {
        case RESET:
            strobe(core.p_clear);
            all = longest = 0;
            break;
        case STEP: {
            const int32_t cycles = strobe(core.p_step);
            all += cycles;
            longest = std::max(longest, cycles);
            break;
        }
        case SPIKE:
            core.p_channel.set<uint32_t>(uint32_t(commands[++i]));
            strobe(core.p_push);
            break;
        case ANSWER: {
            const bool answered = core.p_answered.get<bool>();
            const int32_t label = answered ? core.p_answer.get<int32_t>() : -1;
            const int32_t steps = core.p_answered__after.get<int32_t>();
            written.insert(written.end(), {-1, label, steps, core.p_confident.get<bool>(), 2, all, longest});
            break;
        }
        default:
            break;
        }
    }
    return fwrite(written.data(), sizeof(int32_t), written.size(), stdout) == written.size() ? 0 : 3;
}
