// Runs commands from stdin in the simulated core and writes what came of them: numbers of 32 bits.
//
// in, out: as of replay.c, but that a layer other than the input is 1 and neurons are counted through all layers; and
//          instead of the counts of outputs come the clock cycles of all steps of the window, of its samples, and of
//          the longest step with its samples. SENSORS: samples of a step.
#include "core.cc"
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <vector>

enum { INIT, RESET, STEP, SPIKE, SAMPLE, ANSWER = 7 };

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
    if (core.p_encodes.get<bool>()) {
        written.insert(written.end(), {0, core.p_network__step.get<int32_t>(), core.p_encoded.get<int32_t>()});
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
    int32_t number, all = 0, longest = 0, sampling = 0, samples = 0;
    size_t window = 0; // where what it has written begins
    while (fread(&number, sizeof number, 1, stdin) == 1) {
        commands.push_back(number);
    }
    while (!tick()) { // it is turned on
    }
    for (size_t i = 0; i < commands.size(); i++) {
        switch (commands[i]) {
        case INIT:
            strobe(core.p_start);
            break;
        case RESET:
            strobe(core.p_clear);
            if (SENSORS) { // what samples before the window have made
                written.resize(window);
            }
            all = longest = sampling = samples = 0;
            break;
        case STEP: {
            const int32_t cycles = strobe(core.p_step);
            all += cycles;
            longest = std::max(longest, cycles + sampling);
            sampling = 0;
            break;
        }
        case SAMPLE:
            for (int k = 0; k < SENSORS; k++) {
                core.p_sample.set<uint32_t>(uint32_t(commands[++i]) & 0xFFFF);
                const int32_t cycles = strobe(core.p_sense);
                sampling += cycles;
                samples += cycles;
            }
            break;
        case SPIKE:
            core.p_channel.set<uint32_t>(uint32_t(commands[++i]));
            strobe(core.p_push);
            break;
        case ANSWER: {
            const bool answered = core.p_answered.get<bool>();
            const int32_t label = answered ? core.p_answer.get<int32_t>() : -1;
            const int32_t steps = core.p_answered__after.get<int32_t>();
            written.insert(written.end(), {-1, label, steps, core.p_confident.get<bool>(), 3, all, samples, longest});
            window = written.size();
            break;
        }
        default:
            break;
        }
    }
    return fwrite(written.data(), sizeof(int32_t), written.size(), stdout) == written.size() ? 0 : 3;
}
