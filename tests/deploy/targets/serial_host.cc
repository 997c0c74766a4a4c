// The host of top.v: sends bytes over the serial port and reads what comes back, in the simulated circuit.
//
// in: transmissions: the length of a bit in hundredths of a clock cycle, and how many numbers follow, 4 bytes
//     each, little-endian; then numbers of two bytes, the high one first. out: for 65534 and 65535 the byte that comes back, and the light of the board.
#include "top.cc"
#include <cstdint>
#include <cstdio>

static const int64_t PATIENCE = 10000000;   // clock cycles for an answer
static cxxrtl_design::p_top top;
static int64_t now, bit;                    // in hundredths of a cycle

static void wait_until(int64_t end)
{
    for (; now < end; now += 100) {
        top.p_clk.set<bool>(false);
        top.step();
        top.p_clk.set<bool>(true);
        top.step();
    }
}

static void send(int byte)
{
    const int frame = byte << 1 | 0x200;
    const int64_t begin = now;
    for (int k = 0; k < 10; k++) {
        top.p_rx.set<bool>(frame >> k & 1);
        wait_until(begin + (k + 1) * bit);
    }
}

// Returns the byte that comes back, or -1.
static int receive()
{
    const int64_t last = now + 100 * PATIENCE;
    while (top.p_tx.get<bool>()) {
        if (now > last) {
            return -1;
        }
        wait_until(now + 100);
    }
    const int64_t begin = now;
    int byte = 0;
    for (int k = 0; k < 8; k++) {
        wait_until(begin + bit * (2 * k + 3) / 2);
        byte |= int(top.p_tx.get<bool>()) << k;
    }
    wait_until(begin + 19 * bit / 2);
    return top.p_tx.get<bool>() ? byte : -1;
}

int main()
{
    int32_t head[2];
    bool is_sample = false;
    top.p_rx.set<bool>(true);
    wait_until(200000);
    while (fread(head, sizeof head, 1, stdin) == 1) {
        bit = head[0];
        for (int k = 0; k < head[1]; k++) {
            const int high = getchar(), low = getchar();
            send(high);
            send(low);
            if (!is_sample && (high << 8 | low) >= 65534) {
                const int byte = receive();
                if (byte < 0) {
                    fputs("error: no byte comes back\n", stderr);
                    return 3;
                }
                putchar(byte);
                putchar(top.p_led.get<bool>());
            }
            is_sample = !is_sample && (high << 8 | low) == 65532;
        }
    }
    return 0;
}
