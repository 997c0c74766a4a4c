// What arrives at each neuron in this step and the next ones: sums of weights, a slot per step.
//
// A row of weights is added in as many cycles, and 3 more until `idle`, each weight its delay later than `next_slot`.
// `row` is the place of its first weight, for neurons from `first` on. Or IS_SPARSE: its number; lists.hex has where
// each begins, a weight names its neuron, and 3 cycles more go by.
module arrivals #(
    parameter NEURON_BITS = 1, SLOT_BITS = 1, SUM_BITS = 8, WEIGHT_BITS = 8, DELAY_BITS = 0, ADDRESS_BITS = 1,
              N_WEIGHTS = 1, N_NEURONS = 1, IS_SPARSE = 0, N_LISTS = 1
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
    localparam WORD_BITS = WEIGHT_BITS + DELAY_BITS + (IS_SPARSE ? NEURON_BITS : 0);

    (* no_rw_check, ram_style = "block" *) reg signed [SUM_BITS-1:0] sums [0:(N_NEURONS<<SLOT_BITS)-1];
    (* ram_style = "block" *) reg [WORD_BITS-1:0] weights [0:N_WEIGHTS-1];
    initial $readmemh("weights.hex", weights);

    reg reads = 0, has_read = 0, adds = 0;
    reg [ADDRESS_BITS-1:0] at = 0;
    reg [NEURON_BITS-1:0] left = 0;
    reg [SLOT_BITS-1:0] from = 0;
    reg [WORD_BITS-1:0] read = 0;
    reg signed [WEIGHT_BITS-1:0] weight = 0;
    reg [PLACE_BITS-1:0] place = 0;

    wire [SLOT_BITS-1:0] due;
    generate
        if (DELAY_BITS == 0) assign due = from;
        else assign due = from + read[WEIGHT_BITS +: DELAY_BITS];
    endgenerate

    // The row that is added next: where it begins, how long it is, and the neuron of the weight that was read.
    wire finds, found;
    wire [ADDRESS_BITS-1:0] begin_;
    wire [NEURON_BITS-1:0] length_, target_read;
    generate
        if (IS_SPARSE) begin : of_lists
            (* ram_style = "block" *) reg [ADDRESS_BITS-1:0] begins [0:N_LISTS];
            initial $readmemh("lists.hex", begins);
            reg [ADDRESS_BITS-1:0] number = 0, from_ = 0, end_ = 0;
            reg [2:0] waits = 0;
            always @(posedge clk) begin
                waits <= {waits[1:0], send};
                number <= send ? row : number + 1'b1;
                end_ <= begins[number];
                from_ <= end_;
            end
            assign finds = waits != 0;
            assign found = waits[2] && from_ != end_;
            assign begin_ = from_;
            assign length_ = end_ - from_;
            assign target_read = read[WEIGHT_BITS+DELAY_BITS +: NEURON_BITS];
        end else begin : of_all
            reg [NEURON_BITS-1:0] target = 0, after = 0;
            always @(posedge clk) begin
                target <= send ? first : target + reads;
                after <= target;
            end
            assign finds = 0;
            assign found = send;
            assign begin_ = row;
            assign length_ = length;
            assign target_read = after;
        end
    endgenerate

    wire signed [SUM_BITS-1:0] sum = arrived + weight;

    assign idle = !finds && !reads && !has_read && !adds;

    always @(posedge clk) begin
        if (send) from <= next_slot;
        if (found) begin
            at <= begin_;
            left <= length_;
        end else if (reads) begin
            at <= at + 1'b1;
            left <= left - 1'b1;
        end
        reads <= found || reads && left != 1;

        read <= weights[at];
        has_read <= reads;

        arrived <= sums[has_read ? {target_read, due} : {neuron, slot}];
        weight <= read[WEIGHT_BITS-1:0];
        place <= {target_read, due};
        adds <= has_read;

        if (adds || drop) sums[adds ? place : {neuron, slot}] <= adds ? sum : 0;
    end
endmodule
