/* Rules of detection on one gyro and its angle, tuned by simulation to a mean run length; their mean delays.
 *
 * usage: quickest RULE GYRO_NOISE ANGLE_NOISE TS BIAS FACTOR RUN_LENGTH SAMPLES FLIGHTS SEED
 * RULE: 0 Page's CUSUM, 1 Shiryaev-Roberts; FACTOR: times the bias that the rule expects.
 * Prints the threshold, the mean run length that it had, the mean delay in seconds and its standard error.
 * Gyro and angle are simulated as such, and the filter's gain comes from iterating its variance.
 */
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

static uint64_t state;
static double uniform(void) { /* splitmix64 */
    uint64_t z = (state += 0x9e3779b97f4a7c15ULL);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
    return ((double)((z ^ (z >> 31)) >> 11) + 0.5) / 9007199254740992.0;
}
static double normal(void) {
    static double kept;
    static int there;
    double radius, angle;
    if (there) { there = 0; return kept; }
    radius = sqrt(-2.0 * log(uniform()));
    angle = 6.283185307179586 * uniform();
    kept = radius * sin(angle);
    there = 1;
    return radius * cos(angle);
}

static double gyro_noise, angle_noise, period, gain, deviation, expected;
static double estimate; /* of the angle, whose truth is 0 */
static int rule;

static double innovation(double bias) {
    double off;
    estimate += period * (gyro_noise * normal() + bias); /* carries the estimate on to this sample */
    off = angle_noise * normal() - estimate;
    estimate += gain * off;
    return off / deviation;
}
static double statistic(double last, double z) { /* log of R for Shiryaev-Roberts */
    double nats = expected * z - expected * expected / 2.0;
    if (rule) return log1p(exp(last)) + nats;
    return (last > 0.0 ? last : 0.0) + nats;
}
static double run_length(double threshold, double samples) {
    double w = rule ? -1e3 : 0.0, alarms = 0.0;
    for (double k = 0; k < samples; k++) {
        w = statistic(w, innovation(0.0));
        if (w >= threshold) { alarms++; w = rule ? -1e3 : 0.0; }
    }
    return samples / (alarms > 0.5 ? alarms : 0.5);
}

int main(int count, char **given) {
    double bias, wanted, samples, flights, threshold, length = 0.0, total = 0.0, squares = 0.0, variance = 1.0;
    if (count != 11) return 2;
    rule = atoi(given[1]);
    gyro_noise = atof(given[2]); angle_noise = atof(given[3]); period = atof(given[4]); bias = atof(given[5]);
    expected = atof(given[6]); wanted = atof(given[7]); samples = atof(given[8]); flights = atof(given[9]);
    state = (uint64_t)atoll(given[10]);
    for (int k = 0; k < 100000; k++) {
        gain = variance / (variance + angle_noise * angle_noise);
        deviation = sqrt(variance + angle_noise * angle_noise);
        variance = (1.0 - gain) * variance + period * period * gyro_noise * gyro_noise;
    }
    expected *= -period * bias / gain / deviation; /* where a bias takes the innovations' mean */
    threshold = log(wanted * expected * expected / 2.0 + 2.0) + rule * log(2.0 / expected / expected);
    for (int k = 0; k < 6; k++) { /* the run length grows with e to the threshold */
        length = run_length(threshold, k < 5 ? samples / 10.0 * (k == 4 ? 3.0 : 1.0) : samples);
        if (k < 5) threshold += log(wanted / length);
    }
    for (double flight = 0; flight < flights; flight++) {
        double w = 0.0, delay = 0.0;
        int settle = (int)fmin(wanted, 2000.0 + 20.0 / expected / expected);
        for (int k = 0; k < settle; k++) { /* to its stationary state */
            w = statistic(w, innovation(0.0));
            if (w >= threshold) w = rule ? -1e3 : 0.0;
        }
        for (int k = 0;; k++) {
            w = statistic(w, innovation(bias));
            if (w >= threshold) { delay = k * period; break; }
        }
        total += delay;
        squares += delay * delay;
    }
    total /= flights;
    printf("%.6f %.1f %.6f %.6f\n", threshold, length, total, sqrt((squares / flights - total * total) / flights));
    return 0;
}
