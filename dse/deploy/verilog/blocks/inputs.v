// The input spikes of this step and of those before, a bit each, and which of them reach the first layer now.
//
// Copy k of the inputs spikes LAGS[k] input steps later, in part LAG_PARTS[k] of the step. A word of 16 channels
// without a spike takes 2 cycles.
module inputs #(
    parameter N_CHANNELS = 1, WORD_BITS = 1, SAMPLE_BITS = 1, N_COPIES = 1, COPY_BITS = 1, LAGS = 0, LAG_PARTS = 0,
              PART_BITS = 1, ADDRESS_BITS = 1, ROW = 1
) (
    input wire clk,
    input wire push,
    input wire [15:0] channel,
    output wire pushing,
    input wire run,
    input wire [PART_BITS-1:0] part,
    input wire idle,                      // a row can be sent
    output wire sends,
    output reg [ADDRESS_BITS-1:0] row,
    output wire done,
    input wire clear,
    input wire wipe,                      // the bits of the next input step, or of all
    input wire all,
    output wire wiped
);
    localparam N_WORDS = (N_CHANNELS + 15) / 16;
    localparam REST = N_CHANNELS - 16 * (N_WORDS - 1);
    localparam FETCH = 2'd0, LOAD = 2'd1, SCAN = 2'd2;

    (* no_rw_check, ram_style = "block" *) reg [15:0] memory [0:(1<<(SAMPLE_BITS+WORD_BITS))-1];
    reg [15:0] found, bits = 0, pushed = 0;
    reg [WORD_BITS+3:0] place = 0;
    reg [1:0] pushes = 0, phase = FETCH;
    reg [SAMPLE_BITS-1:0] sample = 0;
    reg [WORD_BITS-1:0] word = 0;
    reg [COPY_BITS-1:0] copy = 0;
    reg [ADDRESS_BITS-1:0] word_row = 0;

    wire [SAMPLE_BITS-1:0] lag = LAGS[SAMPLE_BITS*copy +: SAMPLE_BITS];
    wire is_due = part == LAG_PARTS[PART_BITS*copy +: PART_BITS];
    wire is_last_word = word == N_WORDS - 1;
    wire is_last_copy = copy == N_COPIES - 1;
    wire [SAMPLE_BITS-1:0] other = run ? -lag : wipe;
    wire [SAMPLE_BITS-1:0] slot = sample + other;
    wire [WORD_BITS+SAMPLE_BITS-1:0] address = {slot, pushing ? place[WORD_BITS+3:4] : word};
    wire ends_word = phase == LOAD && found == 0 || phase == SCAN && bits == 0;
    wire skips_copy = phase == FETCH && !is_due;
    wire ends_copy = ends_word && is_last_word || skips_copy;

    assign pushing = pushes != 0;
    assign sends = phase == SCAN && bits[0] && idle;
    assign done = run && ends_copy && is_last_copy;
    assign wiped = is_last_word && (!all || &sample);

    always @(posedge clk) begin
        found <= memory[address];
        if (wipe || pushes[1]) memory[address] <= wipe ? 16'd0 : found | pushed;

        pushes <= {pushes[0], push && channel < N_CHANNELS};
        if (push) begin
            place <= channel[WORD_BITS+3:0];
            pushed <= 16'd1 << channel[3:0];
        end

        if (clear) sample <= 0;
        if (wipe) begin
            word <= is_last_word ? 0 : word + 1'b1;
            if (is_last_word) sample <= sample + 1'b1;
        end

        if (!run) begin
            phase <= FETCH;
            copy <= 0;
            word_row <= 0;
            if (!wipe) word <= 0;
        end else begin
            if (phase == FETCH) phase <= LOAD;
            if (phase == LOAD) begin
                phase <= SCAN;
                bits <= found;
                row <= word_row;
            end
            if (phase == SCAN && (!bits[0] || idle)) begin
                bits <= bits >> 1;
                row <= row + ROW;
            end
            if (ends_word || skips_copy) begin
                phase <= FETCH;
                word_row <= word_row + (skips_copy ? N_CHANNELS * ROW : is_last_word ? REST * ROW : 16 * ROW);
                word <= ends_copy ? 0 : word + 1'b1;
                if (ends_copy) copy <= copy + 1'b1;
            end
        end
    end
endmodule
