// The network behind a serial port. The host sends numbers of two bytes, the high one first:
//
//   0 to 65531   this channel spikes in the input step
//   65532        the next number is the sample of the next sensor, -32768 to 32767 in two's complement
//   65533        a recording begins: the next sample is its first
//   65534        the input step is complete; comes back: a byte, the class, 255 while there is none, or
//                254 for a combination of several heads that is no class
//   65535        a window begins; comes back: 255
//
// It sends the next number after it has read what comes back.
module top #(parameter CYCLES = 12) (
    input wire clk,
    input wire rx,
    output wire tx,
    output wire led
);
    wire received, sending, ready, answered, confident;
    wire [7:0] byte_in;
    wire [7:0] answer;
    reg [7:0] high = 0;
    reg is_low = 0, is_sample = 0, push = 0, sense = 0, start = 0, step = 0, clear = 0, owes = 0;
    reg [15:0] channel = 0;
    wire [15:0] number = {high, byte_in};
    wire replies = owes && ready && !step && !clear && !sending;

    uart #(.CYCLES(CYCLES)) port (
        .clk(clk), .rx(rx), .tx(tx), .received(received), .byte_in(byte_in), .send(replies),
        .byte_out(answered ? answer : 8'd255), .sending(sending)
    );
    core network (
        .clk(clk), .clear(clear), .push(push), .channel(channel), .sense(sense), .sample(channel), .start(start),
        .step(step), .ready(ready), .answered(answered), .confident(confident), .answer(answer), .encodes(), .encoded(),
        .spiked(), .neuron(), .network_step(), .answered_after()
    );
    assign led = confident;

    always @(posedge clk) begin
        push <= 0;
        sense <= 0;
        start <= 0;
        if (ready) begin
            step <= 0;
            clear <= 0;
        end
        if (replies) owes <= 0;
        if (received) begin
            is_low <= !is_low;
            high <= byte_in;
            channel <= number;
            if (is_low) begin
                is_sample <= !is_sample && number == 65532;
                sense <= is_sample;
                push <= !is_sample && number < 65532;
                start <= !is_sample && number == 65533;
                step <= !is_sample && number == 65534;
                clear <= !is_sample && number == 65535;
                owes <= !is_sample && number >= 65534;
            end
        end
    end
endmodule
