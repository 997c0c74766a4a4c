// What arrives at each neuron in this step and the next ones: sums of weights, a slot per step.
//
// A row of weights is added in as many cycles, and 3 more until `idle`, each weight its delay later than `next_slot`.
module arrivals #(
    parameter NEURON_BITS = 1, SLOT_BITS = 1, SUM_BITS = 8, WEIGHT_BITS = 8, DELAY_BITS = 0, ADDRESS_BITS = 1,
              N_WEIGHTS = 1, N_NEURONS = 1
) (
    input wire clk,
    input wire send,
    input wire [ADDRESS_BITS-1:0] row,
    input wire [NEURON_BITS-1:0] first,
    input wire [NEURON_BITS-1:0] length,
    input wire [SLOT_BITS-1:0] next_slot,
    output wire idle,
    input wire [NEURON_BITS-1:0] neuron,
    input wire [SLOT_BITS-1:0] slot,
    output reg signed [SUM_BITS-1:0] arrived,   // at a neuron in a slot, a cycle later
    input wire drop                             // sets it to 0
);
    localparam PLACE_BITS = NEURON_BITS + SLOT_BITS;

    (* no_rw_check, ram_style = "block" *) reg signed [SUM_BITS-1:0] sums [0:(N_NEURONS<<SLOT_BITS)-1];
    (* ram_style = "block" *) reg [DELAY_BITS+WEIGHT_BITS-1:0] weights [0:N_WEIGHTS-1];
    initial $readmemh("weights.hex", weights);

    reg reads = 0, has_read = 0, adds = 0;
    reg [ADDRESS_BITS-1:0] at = 0;
    reg [NEURON_BITS-1:0] target = 0, left = 0, target_read = 0;
    reg [SLOT_BITS-1:0] from = 0;
    reg [DELAY_BITS+WEIGHT_BITS-1:0] read = 0;
    reg signed [WEIGHT_BITS-1:0] weight = 0;
    reg [PLACE_BITS-1:0] place = 0;

    wire [SLOT_BITS-1:0] due;
    generate
        if (DELAY_BITS == 0) assign due = from;
        else assign due = from + read[WEIGHT_BITS +: DELAY_BITS];
    endgenerate

    wire signed [SUM_BITS-1:0] sum = arrived + weight;

    assign idle = !reads && !has_read && !adds;

    always @(posedge clk) begin
        if (send) begin
            at <= row;
            target <= first;
            left <= length;
            from <= next_slot;
        end else if (reads) begin
            at <= at + 1'b1;
            target <= target + 1'b1;
            left <= left - 1'b1;
        end
        reads <= send || reads && left != 1;

        read <= weights[at];
        target_read <= target;
        has_read <= reads;

        arrived <= sums[has_read ? {target_read, due} : {neuron, slot}];
        weight <= read[WEIGHT_BITS-1:0];
        place <= {target_read, due};
        adds <= has_read;

        if (adds || drop) sums[adds ? place : {neuron, slot}] <= adds ? sum : 0;
    end
endmodule
