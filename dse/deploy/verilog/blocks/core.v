// A network of spiking neurons: one neuron after the other, one weight after the other.
//
// A network step takes 5 cycles per neuron, and one per weight that a spike meets. Strobes, taken while `ready`:
//   clear   a window begins: all states are 0
//   push    `channel` spikes in this input step; pushed twice it spikes once
//   sense   `sample` is that of the next sensor in this input step, where the circuit encodes samples
//   start   a recording begins: the next sample is its first
//   step    the input step is complete: its network steps run
// `spiked` tells every spike of a neuron, in `network_step`, and `encodes` every one of a channel that samples make;
// neurons are counted through all layers.
module core (
    input wire clk,
    input wire clear,
    input wire push,
    input wire [15:0] channel,
    input wire sense,
    input wire [15:0] sample,
    input wire start,
    input wire step,
    output wire ready,
    output wire encodes,
    output wire [15:0] encoded,
    output wire spiked,
    output wire [15:0] neuron,
    output wire [31:0] network_step,
    output wire answered,
    output wire confident,
    output wire [7:0] answer,
    output wire [31:0] answered_after
);
    `include "parameters.vh"

    localparam CLEAR = 3'd0, WIPE = 3'd1, IDLE = 3'd2, INPUT = 3'd3, DECIDE = 3'd4, UPDATE = 3'd5, SEND = 3'd6;

    reg [2:0] state = CLEAR;
    reg [NEURON_BITS-1:0] at = 0;     // neuron
    reg [LAYER_BITS-1:0] layer = 0;   // of it
    reg [ADDRESS_BITS-1:0] row = 0;   // first weight that a spike of it meets, or the number of its list
    reg [STEP_BITS-1:0] now = 0;      // network step
    reg [PART_BITS-1:0] part = 0;     // of the input step
    reg [SLOT_BITS-1:0] clearing = 0;

    wire [NEURON_BITS-1:0] length = LENGTH[NEURON_BITS*layer +: NEURON_BITS];  // of a row
    wire is_last = at == N_NEURONS - 1;
    wire is_last_of_layer = at == LAST[NEURON_BITS*layer +: NEURON_BITS];
    wire is_last_part = part == PARTS - 1;
    wire is_output = layer == N_LAYERS - 1;
    wire in_window = now <= LAST_NETWORK_STEP;

    wire pushing, encoding, input_sends, input_done, wiped, idle, done, fires, taking;
    wire [ADDRESS_BITS-1:0] input_row;
    wire [STEP_BITS-1:0] steps;
    wire signed [SUM_BITS-1:0] arrived;
    wire sends = spiked && length != 0;

    assign ready = state == IDLE && !pushing && !encoding;
    assign spiked = done && fires;
    assign neuron = at;
    assign network_step = now;
    assign answered_after = steps;

    generate
        if (HAS_ENCODER) begin : of_samples
            encoder #(
                .N_SENSORS(N_SENSORS), .SENSOR_BITS(SENSOR_BITS), .N_THRESHOLDS(N_THRESHOLDS),
                .SAMPLE_SHIFT(SAMPLE_SHIFT), .THRESHOLDS(THRESHOLDS), .PLACE_BITS(PLACE_BITS), .N_LEVELS(N_LEVELS),
                .FOLLOWS(FOLLOWS), .IS_SHARED(IS_SHARED), .HAS_BEGINS(HAS_BEGINS), .IS_MERGED(IS_MERGED)
            ) of_sensors (
                .clk(clk), .start(start && ready), .sense(sense && ready), .sample(sample), .pushing(pushing),
                .push(encodes), .channel(encoded), .busy(encoding)
            );
        end else begin : of_spikes
            assign encodes = 0;
            assign encoded = 0;
            assign encoding = 0;
        end
    endgenerate

    inputs #(
        .N_CHANNELS(N_CHANNELS), .WORD_BITS(WORD_BITS), .SAMPLE_BITS(SAMPLE_BITS), .N_COPIES(N_COPIES),
        .COPY_BITS(COPY_BITS), .LAGS(LAGS), .LAG_PARTS(LAG_PARTS), .PART_BITS(PART_BITS),
        .ADDRESS_BITS(ADDRESS_BITS), .ROW(IS_SPARSE ? 1 : FIRST_LENGTH)
    ) of_channels (
        .clk(clk), .push(push && ready || encodes), .channel(encodes ? encoded : channel), .pushing(pushing),
        .run(state == INPUT), .part(part),
        .idle(idle), .sends(input_sends), .row(input_row), .done(input_done), .clear(state == CLEAR),
        .wipe(state == WIPE), .all(now == 0), .wiped(wiped)
    );

    arrivals #(
        .NEURON_BITS(NEURON_BITS), .SLOT_BITS(SLOT_BITS), .SUM_BITS(SUM_BITS), .WEIGHT_BITS(WEIGHT_BITS),
        .DELAY_BITS(DELAY_BITS), .ADDRESS_BITS(ADDRESS_BITS), .N_WEIGHTS(N_WEIGHTS), .N_NEURONS(N_NEURONS),
        .IS_SPARSE(IS_SPARSE), .N_LISTS(N_LISTS)
    ) of_sums (
        .clk(clk), .send(input_sends || sends), .row(sends ? row : input_row),
        .first(sends ? FIRST[NEURON_BITS*layer +: NEURON_BITS] : {NEURON_BITS{1'b0}}),
        .length(sends ? length : FIRST_LENGTH), .next_slot(now[SLOT_BITS-1:0] + sends), .idle(idle),
        .neuron(at), .slot(state == CLEAR ? clearing : now[SLOT_BITS-1:0]), .arrived(arrived),
        .drop(taking || state == CLEAR)
    );

    neurons #(
        .NEURON_BITS(NEURON_BITS), .N_NEURONS(N_NEURONS), .STATE_BITS(STATE_BITS), .SUM_BITS(SUM_BITS),
        .SHIFT(SHIFT)
    ) of_layers (
        .clk(clk), .run(state == UPDATE), .neuron(at), .arrived(arrived), .taking(taking),
        .threshold(THRESHOLD[STATE_BITS*layer +: STATE_BITS]), .done(done), .fires(fires),
        .clear(state == CLEAR), .clear_voltage(clearing[0])
    );

    decision #(
        .OUTPUT_BITS(OUTPUT_BITS), .STEP_BITS(STEP_BITS), .SHARE_BITS(SHARE_BITS), .FIRST_OUTPUT(FIRST_OUTPUT),
        .END_OUTPUT(END_OUTPUT), .IS_EARLY(IS_EARLY), .TOTAL_BITS(TOTAL_BITS), .LEAST_TOTAL(LEAST_TOTAL),
        .NUMERATOR(NUMERATOR), .DENOMINATOR(DENOMINATOR), .LAST_STEP(LAST_STEP), .N_HEADS(N_HEADS),
        .HEAD_BITS(HEAD_BITS), .HEAD_FIRST(HEAD_FIRST), .HEAD_LAST(HEAD_LAST), .STRIDES(STRIDES), .N_JOINT(N_JOINT)
    ) of_answer (
        .clk(clk), .decide(state == DECIDE), .network_step(now), .updated(done && is_output), .spiked(spiked),
        .clear(state == CLEAR), .cleared(at[OUTPUT_BITS-1:0]), .answered(answered), .confident(confident),
        .answer(answer), .answered_after(steps)
    );

    always @(posedge clk) begin
        case (state)
            CLEAR: begin
                now <= 0;
                clearing <= clearing + 1'b1;
                if (&clearing) begin
                    at <= is_last ? 0 : at + 1'b1;
                    if (is_last) state <= WIPE;
                end
            end
            WIPE: if (wiped) state <= IDLE;
            IDLE: begin
                layer <= 0;
                row <= NEURON_LISTS;
                part <= 0;
                if (clear) state <= CLEAR;
                else if (step && in_window && !pushing) state <= INPUT;
            end
            INPUT: if (input_done) state <= DECIDE;
            DECIDE: if (idle) state <= UPDATE;
            default: begin
                if (sends) state <= SEND;
                if (state == UPDATE ? done && !sends : idle) begin  // the next neuron
                    at <= is_last ? 0 : at + 1'b1;
                    row <= is_last ? NEURON_LISTS : row + (IS_SPARSE ? 1'b1 : length);
                    if (is_last_of_layer) layer <= is_last ? 0 : layer + 1'b1;
                    state <= UPDATE;
                    if (is_last) begin
                        now <= now + 1'b1;
                        part <= part + 1'b1;
                        state <= is_last_part ? WIPE : INPUT;
                    end
                end
            end
        endcase
    end
endmodule
