// The Cornell room without fog, of the numbers in ../scene.yaml: the photograph of `cornell` and `cornell_height`.
// Pixel centres; Lambertian surfaces; a POV-Ray light colour is irradiance / pi. Radiance in the lamp's unit.
#version 3.7;
#ifndef (Bounces) #declare Bounces = 3; #end        // 0: direct light only
#ifndef (Lights)  #declare Lights = 16; #end        // squared: small lights that stand for the lamp
global_settings {
  assumed_gamma 1 max_trace_level 12 adc_bailout 0
  #if (Bounces > 0)
    radiosity { count 400, 4000 nearest_count 12 error_bound 0.3 recursion_limit Bounces pretrace_start 0.08
                pretrace_end 0.01 low_error_factor 0.6 gray_threshold 0 brightness 1 minimum_reuse 0.01 }
  #end
}
#ifndef (Emitters_Seen) #declare Emitters_Seen = 1; #end   // 0: the lamp is black where it is seen; what it lights stays
#declare Metre = 10;
#declare Eye = <0.03, 1.04, 3.9>;
#declare Forward = vnormalize(<0.01, 0.97, 0> - Eye);
#declare Right = vnormalize(vcross(Forward, y));
camera { perspective location Eye * Metre direction Forward / (2 * tan(radians(37 / 2))) right Right up vcross(Right, Forward) }
#macro Surface(Albedo) pigment { rgb Albedo } finish { ambient 0 diffuse 1 } #end
#macro Wall(A, B, C, D, Albedo) polygon { 5, A * Metre, B * Metre, C * Metre, D * Metre, A * Metre Surface(Albedo) } #end
#declare White = <0.73, 0.73, 0.73>;
Wall(<-1, 0, 1>, <1, 0, 1>, <1, 0, -1>, <-1, 0, -1>, White)
Wall(<-1, 2, -1>, <1, 2, -1>, <1, 2, 1>, <-1, 2, 1>, White)
Wall(<-1, 0, -1>, <1, 0, -1>, <1, 2, -1>, <-1, 2, -1>, White)
Wall(<-1, 0, 1>, <-1, 0, -1>, <-1, 2, -1>, <-1, 2, 1>, <0.63, 0.065, 0.05>)
Wall(<1, 0, -1>, <1, 0, 1>, <1, 2, 1>, <1, 2, -1>, <0.14, 0.45, 0.091>)
// turned by x' = x cos a + z sin a, z' = -x sin a + z cos a
#macro Box(Centre, Half, Turn)
  box { -Half * Metre, Half * Metre
        matrix <cos(radians(Turn)), 0, -sin(radians(Turn)), 0, 1, 0, sin(radians(Turn)), 0, cos(radians(Turn)), 0, 0, 0>
        translate Centre * Metre Surface(White) }
#end
Box(<-0.33, 0.6, -0.28>, <0.3, 0.6, 0.3>, 18)
Box(<0.33, 0.3, 0.38>, <0.3, 0.3, 0.3>, -18)
// the lamp, seen from below; what it throws upwards is nothing
polygon { 5, <-0.25, 1.98, -0.2> * Metre, <0.25, 1.98, -0.2> * Metre, <0.25, 1.98, 0.2> * Metre, <-0.25, 1.98, 0.2> * Metre,
          <-0.25, 1.98, -0.2> * Metre pigment { rgb <17, 12, 7> } finish { ambient 0 diffuse 0 emission Emitters_Seen } no_radiosity no_shadow }
#declare Cell = <0.5, 0, 0.4> / Lights;
#for (I, 0, Lights - 1)
  #for (J, 0, Lights - 1)
    light_source {
      (<-0.25, 1.98 - 1e-4, -0.2> + Cell * <I + 0.5, 0, J + 0.5>) * Metre rgb <17, 12, 7> / 2
      spotlight point_at (<-0.25, 0, -0.2> + Cell * <I + 0.5, 0, J + 0.5>) * Metre radius 89.8 falloff 89.9 tightness 1
      fade_power 2 fade_distance sqrt(Cell.x * Cell.z / pi) * Metre
      #ifdef (In_Fog) media_attenuation on #end
    }
  #end
#end

// ground truth in fog (make truth) brings the fog along, and takes another camera where it needs one
#ifdef (In_Fog) #include "in_fog.inc" #end
