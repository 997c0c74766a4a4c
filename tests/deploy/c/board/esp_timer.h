// In Arduino.h here.
