// The bridge written by hand, as fast as we know how: the yardstick for the engine.
//
// The same equations, the same mean friction over a step, the same classical Runge-Kutta steps and the same fuzzy
// controllers. Lanes lie side by side in blocks that fill whole vectors; every function works on a block, so that the
// compiler vectorises it; blocks are shared among threads. Sine and cosine are the same kind of polynomial.
//
//   reference MODE PRECISION LANES PERIODS SUBSTEPS REPEATS DATA OUT
//
// MODE is `open` (voltages from DATA, held over each period) or `closed` (both fuzzy controllers, a reference from DATA).
// DATA: doubles; per lane 16 parameters and 3 initial positions, then per period two numbers common to all lanes (open:
// voltages; closed: wanted x and l). OUT: final x, psi, l of every lane. Prints one line of JSON.

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <string>
#include <vector>

#include <omp.h>

constexpr int PARAMETERS = 16;
constexpr int POINTS = 101;

template <typename T> constexpr int WIDTH = 128 / sizeof(T); // two vectors of 64 bytes: enough to hide latencies

template <typename T> struct Block {
    alignas(64) T v[WIDTH<T>];
    T &operator[](int i) { return v[i]; }
    const T &operator[](int i) const { return v[i]; }
};

#define LANES _Pragma("omp simd") for (int i = 0; i < WIDTH<T>; ++i)

template <typename T> struct Plant {
    Block<T> m1, m2, je, g, rx, rp, rl, kx, kl, fx, fl, dead_x, dead_l, lag, scale_x, scale_l;
};

template <typename T> struct State {
    Block<T> x, p, l, vx, vp, vl, lag;
};

template <typename T> inline void sincos(T a, T &s, T &c) {
    T k = std::nearbyint(a * T(0.6366197723675814));
    T r = ((a - k * T(1.57079632673412561417e00)) - k * T(6.07710050630396597660e-11));
    T z = r * r;
    T sn = r + r * z *
                   (T(-1.66666666666666307295e-1) +
                    z * (T(8.33333333332211858878e-3) +
                         z * (T(-1.98412698295895385996e-4) +
                              z * (T(2.75573136213857245213e-6) +
                                   z * (T(-2.50507477628578072866e-8) + z * T(1.58962301576546568060e-10))))));
    T cs = T(1) - T(0.5) * z +
           z * z *
               (T(4.16666666666665929218e-2) +
                z * (T(-1.38888888888730564116e-3) +
                     z * (T(2.48015872888517045348e-5) +
                          z * (T(-2.75573141792967388112e-7) +
                               z * (T(2.08757008419747316778e-9) + z * T(-1.13585365213876817300e-11))))));
    T turn = k - T(4) * std::floor(k * T(0.25));
    bool swap = turn == T(1) || turn == T(3);
    T a1 = swap ? cs : sn, a2 = swap ? sn : cs;
    s = turn >= T(2) ? -a1 : a1;
    c = (turn == T(1) || turn == T(2)) ? -a2 : a2;
}

template <typename T> inline T friction(T v, T a, T w, T level, T h) {
    T needed = -a / (w + T(1e-30));
    T holding = std::min(std::max(needed, -level), level);
    T sliding = v > T(0) ? -level : level;
    T with = a + w * sliding;
    bool slows = v * with < T(0);
    T rest = -v / (slows ? with : T(1));
    T share = slows ? std::min(rest / (h + T(1e-30)), T(1)) : (v == T(0) ? T(0) : T(1));
    return holding + share * (sliding - holding);
}

template <typename T>
inline void accelerate(const Plant<T> &b, const State<T> &s, const Block<T> &ux, const Block<T> &ul,
                       const State<T> &first, T h, Block<T> &ax, Block<T> &ap, Block<T> &al) {
    LANES {
        T sn, cs;
        sincos(s.p[i], sn, cs);
        T m2 = b.m2[i], l = s.l[i];
        T xx = b.m1[i] + m2, ll = m2 + b.je[i], xl = m2 * sn, pp = m2 * l * l, xp = m2 * l * cs;
        T rate = s.vp[i], spin = m2 * l * rate * rate;
        T fx = b.kx[i] * ux[i] - b.rx[i] * s.vx[i] - T(2) * m2 * s.vl[i] * rate * cs + spin * sn;
        T fp = -b.rp[i] * rate - T(2) * m2 * l * s.vl[i] * rate - m2 * b.g[i] * l * sn;
        T fl = b.kl[i] * ul[i] - b.rl[i] * s.vl[i] + spin + m2 * b.g[i] * cs;
        // The mass matrix is an arrow: swing and hoist are coupled through the cart alone.
        T over_p = xp / pp, over_l = xl / ll;
        T wx = T(1) / (xx - xp * over_p - xl * over_l);
        T wxp = -wx * over_p, wxl = -wx * over_l;
        T wpp = T(1) / pp - wxp * over_p, wpl = -wxl * over_p, wll = T(1) / ll - wxl * over_l;
        T rx = wx * fx + wxp * fp + wxl * fl;
        T rp = wxp * fx + wpp * fp + wpl * fl;
        T rl = wxl * fx + wpl * fp + wll * fl;
        T ffx = T(0), ffl = T(0);
        for (int sweep = 0; sweep < 2; ++sweep) {
            ffx = friction(first.vx[i], rx + wxl * ffl, wx, b.fx[i], h);
            ffl = friction(first.vl[i], rl + wxl * ffx, wll, b.fl[i], h);
        }
        ax[i] = rx + wx * ffx + wxl * ffl;
        ap[i] = rp + wxp * ffx + wpl * ffl;
        al[i] = rl + wxl * ffx + wll * ffl;
    }
}

template <typename T> inline T dead(T u, T zone) { return u - std::min(std::max(u, -zone), zone); }

// How much of a lag's distance to its target the first, the middle and the last stages of a step have, so that velocity
// and position move as the lag in closed form moves them; and how much is left after the step.
template <typename T> struct Lag {
    Block<T> first, middle, last, after;

    void set(int i, double h, double constant) {
        const double ratio = h / std::max(constant, 1e-9), mean = -std::expm1(-ratio) / ratio;
        const double early = ratio < 0.02 ? 1 - ratio / 3 + ratio * ratio / 12 : 2 * (1 - mean) / ratio;
        const double gap = std::min(early - mean, mean / 3);
        first[i] = T(mean + 3 * gap), middle[i] = T(mean), last[i] = T(mean - 3 * gap), after[i] = T(std::exp(-ratio));
    }
};

// One period with held voltages: `substeps` classical Runge-Kutta steps.
template <typename T>
void period(const Plant<T> &b, State<T> &s, const Block<T> &volts_x, const Block<T> &volts_l, int substeps, T h,
            const Lag<T> &lag) {
    Block<T> ux, target, ul, ax, ap, al;
    LANES {
        ux[i] = dead(volts_x[i], b.dead_x[i]);
        target[i] = dead(volts_l[i], b.dead_l[i]);
    }
    for (int n = 0; n < substeps; ++n) {
        State<T> first = s, stage = s;
        Block<T> sx{}, sp{}, sl{}, svx{}, svp{}, svl{};
        for (int k = 0; k < 4; ++k) {
            LANES {
                T left = k == 0 ? lag.first[i] : k == 3 ? lag.last[i] : lag.middle[i];
                ul[i] = b.lag[i] > T(0) ? target[i] + (s.lag[i] - target[i]) * left : target[i];
            }
            accelerate(b, stage, ux, ul, first, h, ax, ap, al);
            T weight = k == 0 || k == 3 ? h / T(6) : h / T(3), reach = k == 2 ? h : T(0.5) * h;
            LANES {
                sx[i] += weight * stage.vx[i], sp[i] += weight * stage.vp[i], sl[i] += weight * stage.vl[i];
                svx[i] += weight * ax[i], svp[i] += weight * ap[i], svl[i] += weight * al[i];
                stage.x[i] = first.x[i] + reach * stage.vx[i];
                stage.p[i] = first.p[i] + reach * stage.vp[i];
                stage.l[i] = first.l[i] + reach * stage.vl[i];
                stage.vx[i] = first.vx[i] + reach * ax[i];
                stage.vp[i] = first.vp[i] + reach * ap[i];
                stage.vl[i] = first.vl[i] + reach * al[i];
            }
        }
        LANES {
            s.x[i] += sx[i], s.p[i] += sp[i], s.l[i] += sl[i];
            s.vx[i] += svx[i], s.vp[i] += svp[i], s.vl[i] += svl[i];
            s.lag[i] = target[i] + (s.lag[i] - target[i]) * lag.after[i];
        }
    }
}

template <typename T> inline T trapezoid(T v, T a, T b, T c, T d) {
    T up = b - a > T(1e-9) ? (v - a) / (b - a) : (v >= a ? T(1) : T(0));
    T down = d - c > T(1e-9) ? (d - v) / (d - c) : (v <= d ? T(1) : T(0));
    return std::min(std::max(std::min(up, down), T(0)), T(1));
}

// Sets of error and voltage in the order NB NS ZE PS PB, angle N P; the paper's rules.
template <typename T> struct Base {
    T error[5][4], angle[2][4], limit;
    bool has_angle;
    alignas(64) T out[5][POINTS], grid[POINTS];
};

template <typename T>
void infer(const Base<T> &base, const Block<T> &error, const Block<T> &angle, Block<T> &volts) {
    Block<T> w[5];
    LANES {
        T e = std::min(std::max(error[i], T(-1)), T(1));
        for (int k = 0; k < 5; ++k)
            w[k][i] = trapezoid(e, base.error[k][0], base.error[k][1], base.error[k][2], base.error[k][3]);
    }
    if (base.has_angle) LANES {
        T a = std::min(std::max(angle[i], T(-45)), T(45));
        T n = trapezoid(a, base.angle[0][0], base.angle[0][1], base.angle[0][2], base.angle[0][3]);
        T p = trapezoid(a, base.angle[1][0], base.angle[1][1], base.angle[1][2], base.angle[1][3]);
        w[2][i] = std::max(w[2][i], std::max(n, p));
    }
    Block<T> moment{}, area{};
    for (int q = 0; q < POINTS; ++q) {
        T y = base.grid[q], s0 = base.out[0][q], s1 = base.out[1][q], s2 = base.out[2][q], s3 = base.out[3][q],
          s4 = base.out[4][q];
        LANES {
            T d = std::min(w[0][i], s0);
            d = std::max(d, std::min(w[1][i], s1));
            d = std::max(d, std::min(w[2][i], s2));
            d = std::max(d, std::min(w[3][i], s3));
            d = std::max(d, std::min(w[4][i], s4));
            moment[i] += d * y;
            area[i] += d;
        }
    }
    LANES volts[i] = area[i] > T(0) ? moment[i] / area[i] : T(0);
}

template <typename T> Base<T> make(double small, double big, double limit, bool has_angle) {
    Base<T> b{};
    const double e[5][4] = {{-1, -1, -big, -small}, {-big, -small, -small, 0}, {-small, 0, 0, small},
                            {0, small, small, big}, {small, big, 1, 1}};
    const double a[2][4] = {{-45, -45, -20, -5}, {5, 20, 45, 45}};
    const double f = limit, most = 0.9 * limit, half = 0.5 * limit, third = 0.3 * limit, tenth = 0.1 * limit;
    const double v[5][4] = {{-f, -f, -most, -half}, {-2 * third, -third, -third, 0}, {-tenth, 0, 0, tenth},
                            {0, third, third, 2 * third}, {half, most, f, f}};
    for (int k = 0; k < 5; ++k)
        for (int j = 0; j < 4; ++j) b.error[k][j] = T(e[k][j]);
    for (int k = 0; k < 2; ++k)
        for (int j = 0; j < 4; ++j) b.angle[k][j] = T(a[k][j]);
    for (int q = 0; q < POINTS; ++q) {
        double y = -limit + 2 * limit * q / (POINTS - 1);
        b.grid[q] = T(y);
        for (int k = 0; k < 5; ++k)
            b.out[k][q] = trapezoid<T>(T(y), T(v[k][0]), T(v[k][1]), T(v[k][2]), T(v[k][3]));
    }
    b.limit = T(limit);
    b.has_angle = has_angle;
    return b;
}

template <typename T> int run(bool closed, int lanes, int periods, int substeps, int repeats, const char *in, const char *out) {
    constexpr int W = WIDTH<T>;
    const double dt = closed ? 0.02 : 0.005;
    std::ifstream file(in, std::ios::binary);
    std::vector<double> own(size_t(lanes) * (PARAMETERS + 3)), table(size_t(periods) * 2);
    file.read(reinterpret_cast<char *>(own.data()), own.size() * sizeof(double));
    file.read(reinterpret_cast<char *>(table.data()), table.size() * sizeof(double));
    if (!file) return std::fprintf(stderr, "%s is too short\n", in), 1;
    const int blocks = (lanes + W - 1) / W;
    const T h = T(dt / substeps);
    std::vector<Plant<T>> plants(blocks);
    std::vector<State<T>> starts(blocks), states(blocks);
    std::vector<Lag<T>> lags(blocks);
    for (int n = 0; n < blocks; ++n)
        for (int i = 0; i < W; ++i) {
            const double *p = &own[size_t(std::min(n * W + i, lanes - 1)) * (PARAMETERS + 3)];
            T *fields = reinterpret_cast<T *>(&plants[n]);
            for (int k = 0; k < PARAMETERS; ++k) fields[k * W + i] = T(p[k]);
            std::memset(static_cast<void *>(&starts[n]), 0, i == 0 ? sizeof(State<T>) : 0);
            starts[n].x[i] = T(p[PARAMETERS]), starts[n].p[i] = T(p[PARAMETERS + 1]), starts[n].l[i] = T(p[PARAMETERS + 2]);
            lags[n].set(i, dt / substeps, p[13]);
        }
    const Base<T> cart = make<T>(0.004, 0.08, 3.0, true), hoist = make<T>(0.004, 0.05, 10.0, false);
    double best = 1e300;
    for (int r = 0; r < repeats; ++r) {
        auto begin = std::chrono::steady_clock::now();
#pragma omp parallel for schedule(static)
        for (int n = 0; n < blocks; ++n) {
            State<T> s = starts[n];
            const Plant<T> &b = plants[n];
            Block<T> ux, ul, ex, el, angle;
            for (int k = 0; k < periods; ++k) {
                const T first = T(table[2 * k]), second = T(table[2 * k + 1]);
                if (closed) {
                    LANES {
                        ex[i] = (first - s.x[i]) / b.scale_x[i];
                        el[i] = (second - s.l[i]) / b.scale_l[i];
                        angle[i] = s.p[i] * T(57.29577951308232);
                    }
                    infer(cart, ex, angle, ux);
                    infer(hoist, el, angle, ul);
                } else
                    LANES ux[i] = first, ul[i] = second;
                period(b, s, ux, ul, substeps, h, lags[n]);
            }
            states[n] = s;
        }
        best = std::min(best, std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count());
    }
    std::ofstream result(out, std::ios::binary);
    for (int k = 0; k < lanes; ++k) {
        const State<T> &s = states[k / W];
        double row[3] = {double(s.x[k % W]), double(s.p[k % W]), double(s.l[k % W])};
        result.write(reinterpret_cast<char *>(row), sizeof row);
    }
    const double steps = double(lanes) * periods * substeps;
    // Counted by hand: a stage is 153 operations with its 40 of sine and cosine, its share of the step 24; an inference
    // of two controllers is 2 (101 x 12 + 60).
    const double operations = steps * 4 * 177 + (closed ? double(lanes) * periods * 2 * (POINTS * 12 + 60) : 0);
    std::printf("{\"seconds\": %.6g, \"steps_per_second\": %.6g, \"gflops\": %.4g, \"vector_bytes\": %d, \"threads\": %d}\n",
                best, steps / best, operations / best * 1e-9,
#ifdef __AVX512F__
                64,
#elif defined(__AVX__)
                32,
#else
                16,
#endif
                omp_get_max_threads());
    return 0;
}

int main(int count, char **words) {
    if (count != 9) return std::fprintf(stderr, "usage: reference MODE PRECISION LANES PERIODS SUBSTEPS REPEATS DATA OUT\n"), 2;
    const bool closed = std::string(words[1]) == "closed";
    const int lanes = std::atoi(words[3]), periods = std::atoi(words[4]), substeps = std::atoi(words[5]);
    const int repeats = std::atoi(words[6]);
    return std::string(words[2]) == "float32" ? run<float>(closed, lanes, periods, substeps, repeats, words[7], words[8])
                                              : run<double>(closed, lanes, periods, substeps, repeats, words[7], words[8]);
}
