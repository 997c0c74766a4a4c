// The class of the most output spikes, the lowest on ties: at LAST_STEP, or IS_EARLY as soon as LEAST_TOTAL of them
// came and NUMERATOR / DENOMINATOR of them were of this class. Spikes count one step later.
//
// Heads answer each for outputs of their own, from HEAD_FIRST to HEAD_LAST; joint.hex has the class of each combination.
module decision #(
    parameter OUTPUT_BITS = 1, STEP_BITS = 1, TOTAL_BITS = 1, SHARE_BITS = 1, FIRST_OUTPUT = 0, END_OUTPUT = 1,
              IS_EARLY = 0, LEAST_TOTAL = 0, NUMERATOR = 0, DENOMINATOR = 1, LAST_STEP = 0, N_HEADS = 1, HEAD_BITS = 1,
              HEAD_FIRST = 0, HEAD_LAST = 0, STRIDES = 0, N_JOINT = 1
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
    output wire [7:0] answer,
    output reg [STEP_BITS-1:0] answered_after
);
    (* no_rw_check, ram_style = "block" *) reg [STEP_BITS-1:0] counts [0:(1<<OUTPUT_BITS)-1];
    reg [STEP_BITS-1:0] count = 0;
    reg [OUTPUT_BITS-1:0] output_ = 0;
    reg [N_HEADS*STEP_BITS-1:0] all_most = 0;
    reg [N_HEADS*OUTPUT_BITS-1:0] all_best = HEAD_FIRST;
    reg [HEAD_BITS-1:0] head = 0;                   // of output_
    reg [TOTAL_BITS-1:0] total = 0;
    reg [SHARE_BITS-1:0] needed = 0, reached = 0;   // total * NUMERATOR, most * DENOMINATOR

    wire [HEAD_BITS-1:0] which = N_HEADS == 1 ? 0 : head;  // tools fold a constant
    wire [STEP_BITS-1:0] most = all_most[STEP_BITS*which +: STEP_BITS];
    wire [OUTPUT_BITS-1:0] best = all_best[OUTPUT_BITS*which +: OUTPUT_BITS];
    wire ends_head = N_HEADS > 1 && output_ == HEAD_LAST[OUTPUT_BITS*which +: OUTPUT_BITS];
    wire is_last = network_step == LAST_STEP;
    wire is_sure = !IS_EARLY || total >= LEAST_TOTAL && reached >= needed;
    wire counts_it = updated && spiked && output_ >= FIRST_OUTPUT && output_ < END_OUTPUT;
    wire [STEP_BITS-1:0] counted = count + 1'b1;

    initial answered = 0;
    initial confident = 0;
    initial answered_after = 0;

    generate
        if (N_HEADS == 1) assign answer = all_best - FIRST_OUTPUT;
        else begin : of_combination
            reg [7:0] joint [0:N_JOINT-1];
            reg [7:0] label;
            reg [15:0] at;
            integer k;
            initial $readmemh("joint.hex", joint);
            always @* begin
                at = 0;
                for (k = 0; k < N_HEADS; k = k + 1)
                    at = at + (all_best[OUTPUT_BITS*k +: OUTPUT_BITS] - HEAD_FIRST[OUTPUT_BITS*k +: OUTPUT_BITS]) * STRIDES[16*k +: 16];
            end
            always @(posedge clk) label <= joint[at];
            assign answer = label;
        end
    endgenerate

    always @(posedge clk) begin
        count <= counts[output_];
        if (clear || counts_it) counts[clear ? cleared : output_] <= clear ? 0 : counted;
        if (decide) output_ <= 0;
        else if (updated) output_ <= output_ + 1'b1;
        if (decide) head <= 0;
        else if (updated && ends_head) head <= head + 1'b1;
        if (clear) begin
            answered <= 0;
            confident <= 0;
            all_most <= 0;
            all_best <= HEAD_FIRST;
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
                    all_most[STEP_BITS*which +: STEP_BITS] <= counted;
                    reached <= reached + DENOMINATOR;
                end
                if (counted > most || counted == most && output_ < best)
                    all_best[OUTPUT_BITS*which +: OUTPUT_BITS] <= output_;
            end
        end
    end
endmodule
