// The class of the most output spikes, the lowest on ties: at LAST_STEP, or IS_EARLY as soon as LEAST_TOTAL of them
// came and NUMERATOR / DENOMINATOR of them were of this class. Spikes count one step later.
module decision #(
    parameter OUTPUT_BITS = 1, STEP_BITS = 1, TOTAL_BITS = 1, SHARE_BITS = 1, FIRST_OUTPUT = 0, END_OUTPUT = 1,
              IS_EARLY = 0, LEAST_TOTAL = 0, NUMERATOR = 0, DENOMINATOR = 1, LAST_STEP = 0
) (
    input wire clk,
    input wire decide,
    input wire [STEP_BITS-1:0] network_step,
    input wire updated,                        // the next output has been
    input wire spiked,
    input wire clear,
    input wire [OUTPUT_BITS-1:0] cleared,
    output reg answered,
    output reg confident,
    output wire [OUTPUT_BITS-1:0] answer,
    output reg [STEP_BITS-1:0] answered_after
);
    (* no_rw_check, ram_style = "block" *) reg [STEP_BITS-1:0] counts [0:(1<<OUTPUT_BITS)-1];
    reg [STEP_BITS-1:0] count = 0, most = 0;
    reg [OUTPUT_BITS-1:0] output_ = 0, best = FIRST_OUTPUT;
    reg [TOTAL_BITS-1:0] total = 0;
    reg [SHARE_BITS-1:0] needed = 0, reached = 0;   // total * NUMERATOR, most * DENOMINATOR

    wire is_last = network_step == LAST_STEP;
    wire is_sure = !IS_EARLY || total >= LEAST_TOTAL && reached >= needed;
    wire counts_it = updated && spiked && output_ >= FIRST_OUTPUT && output_ < END_OUTPUT;
    wire [STEP_BITS-1:0] counted = count + 1'b1;

    initial answered = 0;
    initial confident = 0;
    initial answered_after = 0;
    assign answer = best - FIRST_OUTPUT;

    always @(posedge clk) begin
        count <= counts[output_];
        if (clear || counts_it) counts[clear ? cleared : output_] <= clear ? 0 : counted;
        if (decide) output_ <= 0;
        else if (updated) output_ <= output_ + 1'b1;
        if (clear) begin
            answered <= 0;
            confident <= 0;
            most <= 0;
            best <= FIRST_OUTPUT;
            total <= 0;
            needed <= 0;
            reached <= 0;
        end else if (!answered) begin
            if (decide && (is_last || IS_EARLY && is_sure)) begin
                answered <= 1;
                confident <= is_sure;
                answered_after <= network_step + 1'b1;
            end
            if (counts_it) begin
                total <= total + 1'b1;
                needed <= needed + NUMERATOR;
                if (counted > most) begin
                    most <= counted;
                    reached <= reached + DENOMINATOR;
                end
                if (counted > most || counted == most && output_ < best) best <= output_;
            end
        end
    end
endmodule
