// Send-on-delta: a channel spikes where a sample has moved by a threshold since its level was last sent.
//
// Samples come sensor by sensor and meet the thresholds one after the other, 3 cycles each, 6 for one that makes a
// spike. Levels and thresholds are in 2^-SAMPLE_SHIFT of the sample's unit. A level moves to the sample (FOLLOWS) or by
// the threshold; a sensor has one for each threshold, or one alone (IS_SHARED). It begins at the first sample or, with
// HAS_BEGINS, where begins.hex says.
module encoder #(
    parameter N_SENSORS = 1, SENSOR_BITS = 1, N_THRESHOLDS = 1, SAMPLE_SHIFT = 0, THRESHOLDS = 0, PLACE_BITS = 1,
              N_LEVELS = 1, FOLLOWS = 0, IS_SHARED = 0, HAS_BEGINS = 0, IS_MERGED = 0
) (
    input wire clk,
    input wire start,                      // a recording begins
    input wire sense,
    input wire signed [15:0] sample,       // of the next sensor
    input wire pushing,                    // no spike is taken
    output reg push,
    output reg [15:0] channel,
    output wire busy
);
    localparam LEVEL_BITS = 16 + SAMPLE_SHIFT;
    localparam IDLE = 3'd0, FIND = 3'd1, KEEP = 3'd2, READ = 3'd3, JUDGE = 3'd4, SEND = 3'd5;
    localparam BEGINS = N_LEVELS * N_SENSORS;  // place of the first level that a recording begins at

    (* no_rw_check, ram_style = "block" *) reg signed [LEVEL_BITS-1:0] levels [0:BEGINS+HAS_BEGINS*N_SENSORS-1];
    reg signed [LEVEL_BITS-1:0] level, x, beginning;
    reg [2:0] phase = IDLE;
    reg [SENSOR_BITS-1:0] sensor = 0;
    reg [7:0] k = 0;                       // threshold
    reg [PLACE_BITS-1:0] place = 0;        // of the level
    reg [15:0] first = 0;                  // channel of OFF, or of both
    reg begun = 0;

    wire signed [LEVEL_BITS:0] theta = THRESHOLDS[(LEVEL_BITS+1)*k +: LEVEL_BITS+1];
    wire signed [LEVEL_BITS-1:0] before = begun || IS_SHARED && k != 0 ? level : beginning;
    wire signed [LEVEL_BITS:0] moved = x - before;
    wire rises = moved > 0;
    wire spikes = rises ? moved >= theta : -moved >= theta;
    wire signed [LEVEL_BITS-1:0] by = rises ? theta : -theta;
    wire is_last = k == N_THRESHOLDS - 1;

    assign busy = phase != IDLE;

    generate
        if (HAS_BEGINS) initial $readmemh("begins.hex", levels, BEGINS);
    endgenerate

    always @(posedge clk) begin
        level <= levels[place];
        push <= 0;
        case (phase)
            IDLE: begin
                if (start) begin
                    sensor <= 0;
                    begun <= 0;
                end else if (sense) begin
                    x <= $signed(sample) <<< SAMPLE_SHIFT;
                    beginning <= $signed(sample) <<< SAMPLE_SHIFT;
                    k <= 0;
                    place <= HAS_BEGINS && !begun ? BEGINS + sensor : sensor;
                    first <= sensor;
                    phase <= HAS_BEGINS && !begun ? FIND : READ;
                end
            end
            FIND: phase <= KEEP;
            KEEP: begin
                beginning <= level;
                place <= sensor;
                phase <= READ;
            end
            READ: phase <= JUDGE;
            JUDGE: begin
                levels[place] <= !spikes ? before : FOLLOWS ? x : before + by;
                push <= spikes;
                channel <= first + (rises && !IS_MERGED ? N_SENSORS : 0);
                phase <= SEND;
            end
            SEND: if (!push && !pushing) begin
                k <= k + 1'b1;
                if (!IS_SHARED) place <= place + N_SENSORS;
                first <= first + (IS_MERGED ? N_SENSORS : 2 * N_SENSORS);
                phase <= is_last ? IDLE : READ;
                if (is_last) begin
                    sensor <= sensor == N_SENSORS - 1 ? 0 : sensor + 1'b1;
                    if (sensor == N_SENSORS - 1) begun <= 1;
                end
            end
        endcase
    end
endmodule
