// A serial port: 8 bits, no parity, one stop bit, CYCLES clock cycles per bit.
module uart #(parameter CYCLES = 12) (
    input wire clk,
    input wire rx,
    output wire tx,
    output reg received,          // for a cycle
    output reg [7:0] byte_in,
    input wire send,
    input wire [7:0] byte_out,
    output wire sending
);
    reg [2:0] line = 3'b111;
    reg [15:0] wait_in = 0, wait_out = 0;
    reg [3:0] left_in = 0, left_out = 0;
    reg [9:0] shift_out = 10'h3FF;

    initial received = 0;
    initial byte_in = 0;
    assign tx = shift_out[0];
    assign sending = left_out != 0;

    always @(posedge clk) begin
        line <= {line[1:0], rx};
        received <= 0;
        if (left_in == 0) begin
            if (!line[2]) begin
                left_in <= 9;
                wait_in <= CYCLES + CYCLES / 2 - 2;   // the middle of the first bit
            end
        end else if (wait_in != 0) wait_in <= wait_in - 1'b1;
        else begin
            wait_in <= CYCLES - 1;
            left_in <= left_in - 1'b1;
            if (left_in == 1) received <= 1;           // the stop bit
            else byte_in <= {line[2], byte_in[7:1]};
        end

        if (!sending) begin
            if (send) begin
                shift_out <= {1'b1, byte_out, 1'b0};
                left_out <= 10;
                wait_out <= CYCLES - 1;
            end
        end else if (wait_out != 0) wait_out <= wait_out - 1'b1;
        else begin
            wait_out <= CYCLES - 1;
            left_out <= left_out - 1'b1;
            shift_out <= {1'b1, shift_out[9:1]};
        end
    end
endmodule
