double floor(double x);
