/* A compensated sum of floats, precise to the last bits: two floats (Knuth's two-sum). */
struct kiln_sum {
    float high, low;
};

void kiln_add(inout kiln_sum sum, float value)
{
    precise const float s = sum.high + value;
    precise const float b = s - sum.high;
    precise const float e = (sum.high - (s - b)) + (value - b);
    sum.low += e;
    sum.high = s;
}
