// Neurons that leak, add what has arrived, and spike above a threshold, in 5 cycles each:
//
//   u = trunc(u * keep_u / 4096) + (arrived << SHIFT);  v = trunc(v * keep_v / 4096) + u;  spike, v = 0 where v > threshold
module neurons #(
    parameter NEURON_BITS = 1, N_NEURONS = 1, STATE_BITS = 24, SUM_BITS = 8, SHIFT = 7
) (
    input wire clk,
    input wire run,
    input wire [NEURON_BITS-1:0] neuron,
    input wire signed [SUM_BITS-1:0] arrived,
    output wire taking,                       // `arrived` has been added
    input wire signed [STATE_BITS-1:0] threshold,
    output wire done,
    output wire fires,
    input wire clear,                         // sets u, or v, to 0
    input wire clear_voltage
);
    localparam READ_U = 3'd0, READ_V = 3'd1, ADD_ARRIVED = 3'd2, ADD_CURRENT = 3'd3, FIRE = 3'd4;

    (* no_rw_check, ram_style = "block" *) reg signed [STATE_BITS-1:0] states [0:2*N_NEURONS-1];
    (* ram_style = "block" *) reg [12:0] keeps [0:2*N_NEURONS-1];
    initial $readmemh("keeps.hex", keeps);

    reg [2:0] phase = READ_U;
    reg signed [STATE_BITS-1:0] state = 0, sum = 0;
    reg [12:0] keep = 0;
    reg signed [STATE_BITS+13:0] product = 0;

    wire is_negative = product[STATE_BITS+13];
    wire signed [STATE_BITS-1:0] leaked = product[STATE_BITS+11:12];
    wire signed [STATE_BITS-1:0] addend = phase == ADD_ARRIVED ? $signed({arrived, {SHIFT{1'b0}}}) : sum;
    wire rounds_up = is_negative && product[11:0] != 0;   // toward zero
    wire [NEURON_BITS:0] read_at = {neuron, phase != READ_U};
    wire [NEURON_BITS:0] write_at = {neuron, clear ? clear_voltage : phase == FIRE};

    assign taking = phase == ADD_CURRENT;
    assign done = phase == FIRE;
    assign fires = sum > threshold;

    always @(posedge clk) begin
        phase <= run && !done ? phase + 1'b1 : READ_U;
        state <= states[read_at];
        keep <= keeps[read_at];
        product <= state * $signed({1'b0, keep});
        sum <= leaked + addend + $signed({1'b0, rounds_up});
        if (clear || taking || done) states[write_at] <= clear || done && fires ? 0 : sum;
    end
endmodule
